"""Locks of one machine, where two processes must not do the same download or build at once."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SAID_AFTER_S = 1.0
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)


@contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold the lock of a file or folder in the block; wait while another process has it.

    The kernel gives it back when a process ends, however it ends.  False where the disk has no
    locks: nobody waits there, and only what appears by one rename is whole.
    """
    from filelock import FileLock, Timeout

    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path.with_name(f".{path.name}.lock"))
    try:
        lock.acquire(timeout=SAID_AFTER_S)
    except Timeout:
        from gmrdata.stage.progress import console  # which Blender's environment lacks

        what = f"waiting for another process, which works on {path}"
        console.print(what, markup=False, soft_wrap=True)
        lock.acquire()
    except (OSError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno not in NO_LOCKS:
            raise
        Path(lock.lock_file).unlink(missing_ok=True)
    try:
        yield lock.is_locked
    finally:
        if lock.is_locked:
            Path(lock.lock_file).unlink(missing_ok=True)  # while it is held: who waits looks again
            lock.release()
