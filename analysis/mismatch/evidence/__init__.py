"""How much trials say for one account against another."""
