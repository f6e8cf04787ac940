"""Contract of grippers (`drivers.ports`): tests against a device, simulated or real, in a rig."""

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Protocol

import pytest

from drivers import ports
from drivers.errors import GripperFault, LinkError, LinkTimeout, ReadOnlyError
from drivers.ports import Gripper, ObjectState


class GripperRig(Protocol):
    """Test rig that the author of a driver supplies; it starts a device with open jaws, not activated."""

    contact_um: int  # width at which the jaws stop after `put_part`

    def open(self, *, read_only: bool = False) -> AbstractContextManager[Gripper]:
        """Connects through the driver; leaving the context closes the connection."""

    def put_part(self) -> None:
        """Puts something between the jaws."""

    def commanded(self) -> bool:
        """Whether the device has received any command since the rig was created."""

    def commands(self) -> object:
        """A value that changes when the device receives a command."""

    def silence(self) -> None:
        """Makes the device silent from now on."""

    def close(self) -> None:
        """Stops the rig."""


def close(gripper: Gripper, *, fast: bool = False) -> None:
    """Requests closing with the least force, at the least or (`fast`) the greatest speed."""
    gripper.move(-1, gripper.profile.speed_mm_s[fast], gripper.profile.force_n[0])


class GripperContract:
    """Tests that the driver of a gripper has to pass: derive a class `Test...` and implement `make`."""

    def make(self) -> GripperRig:
        """Creates the rig of one test."""
        raise NotImplementedError

    @pytest.fixture
    def rig(self) -> Iterator[GripperRig]:
        """Creates the rig of one test, and closes it after the test."""
        result = self.make()
        yield result
        result.close()

    def test_connect_reads_and_writes_nothing(self, rig: GripperRig) -> None:
        """Connecting sends no command, so that an inactive gripper stays inactive."""
        with rig.open() as gripper:
            assert isinstance(gripper, ports.Gripper)
            assert not gripper.state().activated
        assert not rig.commanded()

    def test_gripper_opened_read_only_refuses_commands(self, rig: GripperRig) -> None:
        """A read-only connection reads the state, refuses commands with a ReadOnlyError, and sends none."""
        with rig.open() as gripper:
            gripper.activate()
        before = rig.commands()
        with rig.open(read_only=True) as gripper:
            assert gripper.state().activated
            with pytest.raises(ReadOnlyError, match="dry run"):
                gripper.move(-1, gripper.profile.speed_mm_s[1], gripper.profile.force_n[0])
            with pytest.raises(ReadOnlyError, match="dry run"):
                gripper.stop()
            assert gripper.state().activated
        assert rig.commands() == before

    def test_wait_after_activate_and_move_returns_at_target(self, rig: GripperRig) -> None:
        """Without a part, `wait` returns the requested width, after closing and after opening half way."""
        with rig.open() as gripper:
            profile = gripper.profile
            gripper.activate()
            assert gripper.state().activated
            close(gripper, fast=True)
            settled = gripper.wait()
            assert settled.width_um == 0
            assert settled.object is ObjectState.AT_TARGET
            assert settled.target_um <= 0
            half_um = profile.reading_um(profile.steps // 2)
            gripper.move(half_um, profile.speed_mm_s[1], profile.force_n[0])
            settled = gripper.wait()
            assert (settled.width_um, settled.target_um) == (half_um, half_um)
            assert settled.seconds > 0.0

    def test_wait_on_a_part_returns_its_width(self, rig: GripperRig) -> None:
        """With a part, `wait` reports the width of contact, and that an object stopped the closing jaws."""
        with rig.open() as gripper:
            gripper.activate()
            rig.put_part()
            close(gripper)
            settled = gripper.wait()
            assert (settled.width_um, settled.object) == (rig.contact_um, ObjectState.CLOSING)

    def test_reconnect_while_holding_keeps_the_part(self, rig: GripperRig) -> None:
        """While a part is held, neither a new connection nor `activate` opens the jaws."""
        with rig.open() as gripper:
            gripper.activate()
            rig.put_part()
            close(gripper)
            gripper.wait()
        with rig.open() as gripper:
            seen = gripper.state()
            assert (seen.activated, seen.width_um) == (True, rig.contact_um)
            assert seen.target_um <= 0
            gripper.activate()
            assert gripper.state().width_um == rig.contact_um

    def test_move_without_activation_is_refused(self, rig: GripperRig) -> None:
        """Without activation a move raises a GripperFault, and nothing is sent."""
        with rig.open() as gripper, pytest.raises(GripperFault, match="not active"):
            close(gripper)
        assert not rig.commanded()

    def test_stop_halfway_leaves_the_jaws_there(self, rig: GripperRig) -> None:
        """After a `stop` during closing, the jaws stand still and are not closed."""
        with rig.open() as gripper:
            gripper.activate()
            close(gripper)
            gripper.stop()
            here = gripper.state().width_um
            threading.Event().wait(0.1)
            assert gripper.state().width_um == here > 0

    def test_wait_without_move_is_refused(self, rig: GripperRig) -> None:
        """`wait` without a move raises a GripperFault."""
        with rig.open() as gripper:
            gripper.activate()
            with pytest.raises(GripperFault, match="no move"):
                gripper.wait()

    def test_state_after_close_is_refused(self, rig: GripperRig) -> None:
        """After `close`, `state` raises a LinkError that says that the link is closed."""
        with rig.open() as gripper:
            gripper.close()
            with pytest.raises(LinkError, match="closed"):
                gripper.state()

    def test_state_of_silent_device_raises_at_the_deadline(self, rig: GripperRig) -> None:
        """If the device is silent, `state` raises a LinkError at the driver's deadline."""
        with rig.open() as gripper:
            rig.silence()
            with pytest.raises(LinkError) as raised:
                gripper.state()
            assert raised.value.exit_code == 21
            if isinstance(raised.value, LinkTimeout):
                assert isinstance(raised.value, TimeoutError)
