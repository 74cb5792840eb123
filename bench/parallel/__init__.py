"""Where tasks are computed: the contract of a place, and the two places of this machine.

What a task comes to does not depend on where it was computed. A place gives back what was done as it is done, and says
which tasks were lost with the process that worked on them. Nothing here knows what the tasks are; the room lies so low
that processes start before the rooms above are imported.
"""

from bench.parallel.places import ATTEMPTS, Lost, Place, in_turn, staying
from bench.parallel.processes import Processes, usable_cores

__all__ = ["ATTEMPTS", "Lost", "Place", "Processes", "in_turn", "staying", "usable_cores"]
