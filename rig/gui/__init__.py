"""The bench window; it drives a runner in a process of its own and only pulls."""
