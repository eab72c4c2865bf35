"""Topics: quality of service, subscriptions that are polled, messages serialized once."""
