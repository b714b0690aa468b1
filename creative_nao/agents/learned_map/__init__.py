"""A learned map: a network that has seen many memories expects what any PB point of an unseen one would earn now."""
