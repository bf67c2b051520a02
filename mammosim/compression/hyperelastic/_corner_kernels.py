"""An element's eight corners, numbered 4 x + 2 y + z, and where each lies from another."""

from mammosim._jit import inlined_kernel


@inlined_kernel
def neighbour(node: int, other: int) -> int:
    """Which of 27 neighbours, 0 itself and 13 the last, a later corner is of an earlier one."""
    return (
        9 * (other // 4 - node // 4)
        + 3 * ((other // 2) % 2 - (node // 2) % 2)
        + other % 2 - node % 2
    )  # fmt: skip
