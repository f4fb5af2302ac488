"""Parts from outside of the package: registered, imported from files and modules, found among what is installed."""
