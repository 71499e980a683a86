"""A test that lets a `KeyboardInterrupt` through fails, and does not end the run of the others."""

import signal

import pytest


class Interrupts:
    """Interrupts of the user end the run; one that a test raises by itself fails this test alone."""

    def __init__(self):
        self.came = False
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self.hear)

    def hear(self, number, frame):
        self.came = True
        signal.default_int_handler(number, frame)

    def fails_alone(self):
        try:
            return (yield)
        except KeyboardInterrupt as interrupt:
            if self.came:
                raise
            raise AssertionError("the test let a KeyboardInterrupt through") from interrupt

    pytest_runtest_setup = pytest.hookimpl(wrapper=True)(fails_alone)
    pytest_runtest_call = pytest.hookimpl(wrapper=True)(fails_alone)
    pytest_runtest_teardown = pytest.hookimpl(wrapper=True)(fails_alone)
