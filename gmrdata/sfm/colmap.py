"""pycolmap, imported in the one order that works, and silent."""

# OpenCV first: with pycolmap loaded before it, cv2.imwrite of a PNG aborts the process, because
# both wheels carry their own libpng (seen with pycolmap 4.2.1 and OpenCV 4.11).
import cv2  # noqa: F401
import pycolmap

# Only fatal messages: what goes wrong is told by our own errors, with the file and the remedy.
pycolmap.logging.minloglevel = 3

__all__ = ["pycolmap"]
