"""``python -m pmjoint_codegen`` is ``pmjoint``."""

from __future__ import annotations

from pmjoint_codegen.cli.main import main

if __name__ == "__main__":
    main()
