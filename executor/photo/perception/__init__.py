"""Who sees what is in a picture when no file says so: a model that is asked, or networks with weights in a folder."""
