"""One hypothesis fitted: parameters with their priors, likelihood, held-out scores."""
