"""Other people's assets: URDF files, PartNet-Mobility folders and meshes become assets of the library."""
