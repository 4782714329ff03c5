"""Scene files: what they leave out comes from the library of models, and what stands where from geometry."""
