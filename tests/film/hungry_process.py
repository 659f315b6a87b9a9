"""A stand-in for Blender that wants 2 GiB, or never ends."""

import sys
import time

from blender.__main__ import limit_memory, run

if __name__ == "__main__":
    limit_memory()
    if (code := run(lambda: bytearray(2 << 30))) == 0:
        time.sleep(60)
    sys.exit(code)
