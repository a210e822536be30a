"""What ``pmjoint export --target`` can write: one module a target, imported when it is asked for."""
