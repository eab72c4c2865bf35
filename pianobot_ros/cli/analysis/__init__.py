"""Commands that compute: diagnosis, identification, results."""
