"""From recordings to a verdict: from bags, live, and by playing on."""
