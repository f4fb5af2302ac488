"""What of the documentation is made of the program; `docs.generated.extension` puts it into the site."""
