"""Who finds things in a picture when no file says where they are: a model that is asked, or a network in a folder."""
