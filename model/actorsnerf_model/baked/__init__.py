"""A fitted actor as one small file, drawn without networks: read `actor`, then `render`."""
