"""Configuration files: experiments and ensembles as TOML, with errors that name key, file and line."""
