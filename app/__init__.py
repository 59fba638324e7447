"""Programs on top of the core: the command line and the benchmark. Installed as `irrsplat.app`."""
