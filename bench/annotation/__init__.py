"""From a raw drive to annotations: the store of proposals and decisions, and the review page."""
