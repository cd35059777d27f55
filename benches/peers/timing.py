"""Speed on one core, in seconds of processor time, so that other programs on the machine count little."""

import resource
import statistics
import time


def processor_seconds():
    """Of this process, all its threads, and of the programs that it ran and that have ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def median_seconds(call, repeats, budget):
    """The median of the processor seconds of `call`, and its last result. The first call warms up and does not count, unless it
    alone exceeds the budget; there are at most `repeats` others, fewer when they exceed the budget."""
    times, warm = [], False
    while True:
        start = processor_seconds()
        result = call()
        seconds = processor_seconds() - start
        if warm or repeats == 0 or seconds > budget:
            times.append(seconds)
        warm = True
        if len(times) >= max(repeats, 1) or sum(times) > budget:
            return statistics.median(times), result
