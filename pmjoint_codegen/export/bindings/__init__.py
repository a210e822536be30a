"""Exported controllers in other languages: written, run there, and compared with this machine."""
