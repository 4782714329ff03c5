"""The parametric models, by kind. Every builder raises AssetError where a size or a parameter does not make one."""
