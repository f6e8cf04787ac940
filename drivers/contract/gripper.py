"""What every gripper must do (`drivers.ports`): tests against a device, simulated or real, in a rig."""

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Protocol

import pytest

from drivers import ports
from drivers.errors import GripperFault, LinkError, LinkTimeout, ReadOnlyError
from drivers.ports import Gripper


class GripperRig(Protocol):
    """A device that is not activated yet, its jaws open, and what a test has to know of it."""

    closed_counts: int  # where the jaws stand, 0 to 255, when they closed on nothing
    contact_counts: int  # where they stop once `put_part` was called

    def open(self, *, read_only: bool = False) -> AbstractContextManager[Gripper]:
        """A connection through the driver, closed when its context is left."""

    def put_part(self) -> None:
        """Put something between the jaws."""

    def commanded(self) -> bool:
        """Whether the device was ever told to do something."""

    def commands(self) -> object:
        """What differs after the device was told to do something."""

    def silence(self) -> None:
        """From now on the device answers nothing."""

    def close(self) -> None:
        """Take it down."""


class GripperContract:
    """Derive a class `Test...` from it and give it `make`."""

    def make(self) -> GripperRig:
        """A rig of its own for each test."""
        raise NotImplementedError

    @pytest.fixture
    def rig(self) -> Iterator[GripperRig]:
        """The rig of one test."""
        result = self.make()
        yield result
        result.close()

    def test_connecting_reads_and_does_not_write(self, rig: GripperRig) -> None:
        """Nothing moves, and an inactive gripper stays so."""
        with rig.open() as gripper:
            assert isinstance(gripper, ports.Gripper)
            assert not gripper.state().activated
        assert not rig.commanded()

    def test_one_opened_for_reading_cannot_be_commanded(self, rig: GripperRig) -> None:
        """A dry run reads, and sends nothing."""
        with rig.open() as gripper:
            gripper.activate()
        before = rig.commands()
        with rig.open(read_only=True) as gripper:
            assert gripper.state().activated
            with pytest.raises(ReadOnlyError, match="dry run"):
                gripper.move(255, 255, 10)
            with pytest.raises(ReadOnlyError, match="dry run"):
                gripper.stop()
            assert gripper.state().activated
        assert rig.commands() == before

    def test_activate_move_wait(self, rig: GripperRig) -> None:
        """A settled reading tells where the jaws are and repeats the request."""
        with rig.open() as gripper:
            gripper.activate()
            assert gripper.state().activated
            gripper.move(255, 255, 10)
            settled = gripper.wait()
            assert settled.position_counts == rig.closed_counts
            assert (settled.object_flag, settled.echo_counts) == (3, 255)
            gripper.move(100, 255, 10)
            settled = gripper.wait()
            assert (settled.position_counts, settled.echo_counts) == (100, 100)
            assert settled.seconds > 0.0

    def test_a_part_stops_the_jaws(self, rig: GripperRig) -> None:
        """The flag tells of contact while closing."""
        with rig.open() as gripper:
            gripper.activate()
            rig.put_part()
            gripper.move(255, 100, 10)
            settled = gripper.wait()
            assert (settled.position_counts, settled.object_flag) == (rig.contact_counts, 2)

    def test_a_holding_gripper_survives_a_reconnection(self, rig: GripperRig) -> None:
        """Connecting resets nothing, and activating what is active opens nothing."""
        with rig.open() as gripper:
            gripper.activate()
            rig.put_part()
            gripper.move(255, 100, 10)
            gripper.wait()
        with rig.open() as gripper:
            seen = gripper.state()
            assert (seen.activated, seen.position_counts) == (True, rig.contact_counts)
            assert seen.echo_counts == 255
            gripper.activate()
            assert gripper.state().position_counts == rig.contact_counts

    def test_moves_need_activation(self, rig: GripperRig) -> None:
        """And nothing is sent without it."""
        with rig.open() as gripper, pytest.raises(GripperFault, match="not active"):
            gripper.move(255, 255, 0)
        assert not rig.commanded()

    def test_stopping_halfway_leaves_the_jaws_there(self, rig: GripperRig) -> None:
        """They stand, not yet closed."""
        with rig.open() as gripper:
            gripper.activate()
            gripper.move(255, 0, 0)
            gripper.stop()
            here = gripper.state().position_counts
            threading.Event().wait(0.1)
            assert gripper.state().position_counts == here < rig.closed_counts

    def test_waiting_for_nothing_is_refused(self, rig: GripperRig) -> None:
        """A reading belongs to a move."""
        with rig.open() as gripper:
            gripper.activate()
            with pytest.raises(GripperFault, match="no move"):
                gripper.wait()

    def test_a_closed_link_stays_closed(self, rig: GripperRig) -> None:
        """It says so."""
        with rig.open() as gripper:
            gripper.close()
            with pytest.raises(LinkError, match="closed"):
                gripper.state()

    def test_a_dead_device_is_a_timeout(self, rig: GripperRig) -> None:
        """A silence ends by the driver's own deadline."""
        with rig.open() as gripper:
            rig.silence()
            with pytest.raises(LinkError) as raised:
                gripper.state()
            assert raised.value.exit_code == 21
            if isinstance(raised.value, LinkTimeout):
                assert isinstance(raised.value, TimeoutError)
