"""A one-joint servo axis as a twin of the generic diagnosis: logs as laboratories have them, laws, a plant for testing."""
