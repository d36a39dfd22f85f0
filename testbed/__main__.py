"""``python -m testbed``: the command without its script."""

from __future__ import annotations

from testbed.cli import main

if __name__ == "__main__":
    main()
