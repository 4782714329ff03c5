"""From nested forms to problems and domains, section by section."""
