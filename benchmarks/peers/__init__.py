"""The contestants, each a module that imports its package only when it is called."""
