"""A worker of pytest-xdist that dies fails the test it was at, and the others' run goes on.

With `--dist loadfile` the scheduler of pytest-xdist 3.8 gives the test that a worker died of, and files
that were done already, to the worker that takes its place: that one dies of it too, or waits for ever for
the answer to no test at all, and the run never ends.
"""

from xdist.scheduler import LoadFileScheduling


class SchedulingPastCrashes(LoadFileScheduling):
    """Whole files to a worker, and what a dead one has left to another, without the test it died of."""

    def remove_node(self, node):
        workload = self.assigned_work.pop(node)
        crashed = None
        for file, tests in workload.items():
            left = {test: False for test, done in tests.items() if not done}
            if left and crashed is None:
                crashed = next(iter(left))
                del left[crashed]
            if left:
                self.workqueue[file] = left
        for other in self.assigned_work:
            self._reschedule(other)
        return crashed

    def _reschedule(self, node):
        # One that is still collecting, in the place of a dead one, gets work once it knows the tests.
        # What it got before would never reach it, and the crash of another would be lost.
        if node.shutting_down or node not in self.registered_collections:
            return
        # A worker begins a test when it knows the one after it: a single one in its hands is never begun.
        while self.workqueue and self._pending_of(self.assigned_work[node]) <= 2:
            waiting = len(self.workqueue)
            self._assign_work_unit(node)
            if len(self.workqueue) == waiting:
                return
        if not self.workqueue:
            node.shutdown()

    def _assign_work_unit(self, node):
        file = next(iter(self.workqueue))
        try:
            super()._assign_work_unit(node)
        except OSError:
            # it is dead and not missed yet: the work goes back, for others once it is
            self.workqueue[file] = self.assigned_work[node].pop(file)
            self.workqueue.move_to_end(file, last=False)
