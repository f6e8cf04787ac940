"""A stream to a device that answers by a script, on a virtual clock."""

from drivers.sim.virtual.clock import VirtualClock


class Line:
    """A stream that answers each request by the next list of `script`.

    The items of a list are (delay [s], bytes) to receive, or errors to raise.
    """

    endpoint = "a line"

    def __init__(self, *script):
        self.clock = VirtualClock()
        self.script = list(script)
        self.coming = []
        self.sent = []
        self.closed = False

    def send(self, data):
        self.sent.append((self.clock.now(), data))
        for step in self.script.pop(0) if self.script else ():
            if isinstance(step, Exception):
                raise step
            self.coming.append((self.clock.now() + step[0], step[1]))
        self.coming.sort()

    def receive(self, seconds):
        if self.coming and self.coming[0][0] <= self.clock.now() + seconds:
            moment, data = self.coming.pop(0)
            self.clock.advance(max(moment, self.clock.now()))
            return data
        self.clock.sleep(seconds)
        return b""

    def close(self):
        self.closed = True
