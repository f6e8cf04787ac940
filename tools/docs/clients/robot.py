"""A robot client of grasp-runtime --serve, in Python: give `locate` a connection and your robot."""

import socket
import sys


class Connection:
    def __init__(self, host, port):
        with socket.create_connection((host, port), timeout=10) as connected:
            self.lines = connected.makefile("rw", newline="\n")  # the file keeps the socket open

    def ask(self, line):
        self.lines.write(line + "\n")
        self.lines.flush()
        words = self.lines.readline().split()
        if not words or words[0] == "ERROR":
            raise RuntimeError(f"{line}: {' '.join(words) or 'the server hung up'}")
        return words


def locate(connection, robot):
    """Locates one part; returns leaf, x mm, y mm, angle deg and success rate, or None if not located."""
    words = connection.ask("NEXT")
    while words[0] == "SQUEEZE":
        node = words[1]
        x, y, angle, opening, speed, force = map(float, words[2:])
        robot.place(x, y, angle, opening)  # up, jaws open, over there, down
        # The settled count, and whether the jaws met something.
        count, held = robot.squeeze(speed, force)
        words = connection.ask(f"COUNTS {count} {'OBJECT' if held else 'NONE'} {node}")
        if words[0] == "DRAG":
            robot.drag(float(words[1]), float(words[2]))  # along the table, without turning
        robot.release()  # open, up
        if words[0] == "DRAG":
            words = connection.ask("NEXT")
    return (int(words[1]), *map(float, words[2:6])) if words[0] == "LEAF" else None


class Person:
    """A robot for a trial: asks a person to move a gripper by hand, and to type its counts."""

    def place(self, x, y, angle, opening):
        input(f"open to {opening:g} mm, put the hand at ({x:g}, {y:g}) mm, {angle:g} deg; Enter ")

    def squeeze(self, speed, force):
        count = int(input(f"close at {speed:g} mm/s with {force:g} N; count? "))
        return count, input("anything held? y/n ") == "y"

    def drag(self, x, y):
        input(f"drag what is held to ({x:g}, {y:g}) mm; Enter ")

    def release(self):
        input("open, lift the hand; Enter ")


if __name__ == "__main__":
    print(locate(Connection(sys.argv[1], int(sys.argv[2])), Person()))
