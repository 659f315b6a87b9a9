"""Threads for work that leaves Python's lock alone, such as reading and writing images."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def own_cores() -> int:
    """Cores for this process: its share of them in a worker, else all of them."""
    share = os.environ.get("OMP_NUM_THREADS", "")
    return int(share) if share.isdecimal() and int(share) > 0 else os.cpu_count() or 1


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """A function of each item, in the items' order, with a thread for each of the own cores.

    Raises:
        Exception: what the function raises for the first item that it does so for; items that are
            not begun then are left alone.
    """
    with ThreadPoolExecutor(own_cores()) as pool:
        return list(pool.map(function, items))
