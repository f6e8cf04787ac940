"""The gripper driver on a virtual clock: stale flags, lost answers, power cuts, deadlines."""

import random

import pytest

from drivers.clock import Pace
from drivers.errors import GripperFault, LinkError, LinkTimeout
from drivers.robotiq.gripper import Gripper
from drivers.robotiq.link import LinkCounters
from drivers.robotiq.registers import OUTPUT_FIELDS, unpack
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.jaws import Jaws

TRANSACTION_S = 0.006


class VirtualClock:
    def __init__(self):
        self.time = 100.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds

    def idle(self, seconds, until):
        self.time += max(min(seconds, until - self.time), 0.0)


class DirectLink:
    """A model without wires; each transaction takes 6 ms. `on_write` may interfere."""

    endpoint = "virtual"

    def __init__(self, seed=1, contact=None):
        self.clock = VirtualClock()
        self.counters = LinkCounters()
        self.contact = contact
        self.asked = 0
        self.writes = []
        self.frozen = None
        self.on_write = None
        self.model = GripperModel(random.Random(seed), Jaws(), self)

    def closing(self):
        self.asked += 1
        return self.contact

    def gripped(self):
        pass

    def released(self):
        pass

    def read(self):
        self.clock.time += TRANSACTION_S
        return self.frozen or self.model.read_input(self.clock.time)[:6]

    def write(self, block):
        self.clock.time += TRANSACTION_S
        self.writes.append(block)
        if self.on_write is not None and self.on_write(block):
            return
        self.model.write_output(0, block, self.clock.time)

    def close(self):
        self.clock.time += TRANSACTION_S


def connect(link):
    return Gripper(link, Pace(link.clock))


def active(**options):
    contact = options.pop("contact", None)
    link = DirectLink(**options)
    gripper = connect(link)
    gripper.activate()
    link.contact, link.writes, link.asked = contact, [], 0
    return link, gripper


def test_connecting_writes_nothing():
    link = DirectLink()
    connect(link).close()
    assert link.writes == []


def test_activation_resets_first_and_takes_its_time():
    link = DirectLink()
    gripper = connect(link)
    gripper.activate()
    assert [unpack(OUTPUT_FIELDS, block)["rACT"] for block in link.writes] == [0, 1]
    assert all(unpack(OUTPUT_FIELDS, block)["rGTO"] == 0 for block in link.writes)
    assert gripper.state().activated
    assert 1.0 < link.clock.time - 100.0 < 15.0


def test_an_active_gripper_is_left_alone():
    link, gripper = active()
    gripper.activate()
    assert link.writes == []


def test_an_activation_under_way_is_waited_for():
    link, _ = DirectLink(), None
    first = connect(link)
    link.model.write_output(0, bytes((1, 0, 0, 0, 0, 0)), link.clock.time)
    first.activate()
    assert link.writes == []
    assert first.state().activated


def test_a_latched_fault_is_reported_and_cleared_only_on_demand():
    link = DirectLink(contact=150)
    gripper = connect(link)
    with pytest.raises(GripperFault, match="0x0D") as raised:
        gripper.activate()
    assert raised.value.code == 0x0D
    link.writes.clear()
    with pytest.raises(GripperFault, match="asked to activate"):
        gripper.activate()
    assert link.writes == []
    link.contact = None
    gripper.activate(after_fault=True)
    assert gripper.state().activated


def test_a_gripper_that_never_finishes_activation_runs_into_the_deadline():
    link = DirectLink()
    gripper = connect(link)
    link.frozen = bytes((0x11, 0, 0, 0, 0, 0))
    with pytest.raises(GripperFault, match="not done activating"):
        gripper.activate()
    assert 15.0 < link.clock.time - 100.0 < 17.0


@pytest.mark.parametrize("seed", range(20))
def test_moves_end_where_the_model_says_whatever_the_lags(seed):
    link, gripper = active(seed=seed)
    rng = random.Random(seed)
    for _ in range(30):
        link.contact = rng.choice([None, rng.randrange(60, 229)])
        target = rng.choice([255, rng.randrange(256)])
        gripper.move(target, rng.randrange(256), rng.randrange(256))
        settled = gripper.wait()
        assert settled.position_counts == round(link.model._stroke.at(1e12))
        assert settled.echo_counts == target
        assert settled.object_flag in {2, 3}
        gripper.move(0, 255, 0)
        assert gripper.wait().position_counts == 3


def test_settled_tells_of_contact_current_and_time():
    _, gripper = active(contact=174)
    gripper.move(255, 255, 100)
    settled = gripper.wait()
    assert (settled.position_counts, settled.object_flag, settled.echo_counts) == (174, 2, 255)
    assert settled.current_ma > 0
    assert settled.seconds == pytest.approx((174 - 3) * 85 / 227 / 150, abs=0.1)


def test_a_move_is_written_once():
    link, gripper = active(contact=174)
    gripper.move(255, 255, 100)
    gripper.wait()
    assert len(link.writes) == 1


def test_already_there_is_a_legal_outcome():
    _, gripper = active(contact=174)
    for _ in range(2):
        gripper.move(255, 255, 100)
        settled = gripper.wait()
        assert (settled.position_counts, settled.object_flag) == (174, 2)


def test_moving_an_inactive_gripper_is_refused_before_anything_is_written():
    link = DirectLink()
    gripper = connect(link)
    with pytest.raises(GripperFault, match="not active"):
        gripper.move(255, 255, 0)
    assert link.writes == []


def test_waiting_for_nothing_is_refused():
    _, gripper = active()
    with pytest.raises(GripperFault, match="no move"):
        gripper.wait()


def test_a_write_that_arrived_without_its_answer_is_written_again_and_changes_nothing():
    link, gripper = active(contact=174)
    lost = [True, True]

    def lose_answer(block):
        link.model.write_output(0, block, link.clock.time)
        link.clock.sleep(0.4)  # the fingers are on their way, or have met the part
        if lost:
            lost.pop()
            raise LinkTimeout("lost", "virtual")
        return True

    link.on_write = lose_answer
    gripper.move(255, 255, 0)
    assert len(link.writes) == 3
    assert len(set(link.writes)) == 1
    assert gripper.wait().position_counts == 174
    assert link.asked == 1


def test_a_write_that_only_raises_the_force_is_repeated_when_it_is_lost():
    """The position is the same, so the echoes tell of the write before."""
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    gripper.wait()

    def lose_request(block):
        link.on_write = None
        raise LinkTimeout("lost", "virtual")

    link.on_write = lose_request
    gripper.move(255, 0, 200)
    assert unpack(OUTPUT_FIELDS, link.model.read_output()[:6])["rFR"] == 200
    assert gripper.wait().position_counts == 174


def test_a_write_that_is_never_acknowledged_is_no_command():
    link, gripper = active()

    def lose_answer(block):
        link.model.write_output(0, block, link.clock.time)
        raise LinkTimeout("lost", "virtual")

    link.on_write = lose_answer
    with pytest.raises(LinkTimeout):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 3


def test_a_write_that_did_not_arrive_is_repeated_once_after_a_look():
    link, gripper = active()

    def lose_request(block):
        link.on_write = None
        raise LinkTimeout("lost", "virtual")

    link.on_write = lose_request
    gripper.move(100, 255, 0)
    assert len(link.writes) == 2
    assert gripper.wait().position_counts == 100


def power_cycle(link):
    link.model = GripperModel(random.Random(9), Jaws(), link)


def test_a_write_lost_to_a_power_cut_is_not_repeated():
    """Repeating it would set rACT in a reset gripper: the activation sweep."""
    link, gripper = active()

    def cut(block):
        power_cycle(link)
        raise LinkTimeout("lost", "virtual")

    link.on_write = cut
    with pytest.raises(GripperFault, match="not active"):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 1
    assert not gripper.state().activating


def test_a_stop_lost_to_a_power_cut_does_not_start_the_sweep():
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)

    def cut(block):
        power_cycle(link)
        raise LinkTimeout("lost", "virtual")

    link.on_write = cut
    with pytest.raises(GripperFault, match="not active"):
        gripper.stop()
    link.on_write = None
    assert not gripper.state().activating


def test_a_power_cut_during_a_move_is_a_fault():
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    power_cycle(link)
    with pytest.raises(GripperFault):
        gripper.wait()


def test_stop_keeps_the_request_and_the_part():
    link, gripper = active(contact=174)
    gripper.move(255, 255, 50)
    gripper.wait()
    gripper.stop()
    image = unpack(OUTPUT_FIELDS, link.writes[-1])
    assert (image["rACT"], image["rGTO"], image["rPR"]) == (1, 0, 255)
    assert gripper.state().position_counts == 174
    assert gripper.state().activated


def test_stop_after_a_power_cut_does_not_start_the_sweep():
    link, gripper = active()
    power_cycle(link)
    link.writes.clear()
    gripper.stop()
    assert link.writes == []


def test_reconnecting_to_a_holding_gripper_and_stopping_it_does_not_open_it():
    link, gripper = active(contact=174)
    gripper.move(255, 255, 50)
    gripper.wait()
    again = connect(link)
    again.stop()
    assert unpack(OUTPUT_FIELDS, link.writes[-1])["rPR"] == 255
    assert again.state().position_counts == 174


def test_stop_halfway():
    link, gripper = active()
    gripper.move(255, 0, 0)
    link.clock.sleep(0.5)
    gripper.stop()
    here = gripper.state().position_counts
    link.clock.sleep(0.9)
    assert gripper.state().position_counts == here
    assert 3 < here < 230


def test_stop_ends_the_sweep_of_an_activation_and_leaves_a_latched_fault_alone():
    link = DirectLink()
    gripper = connect(link)
    link.write(bytes((1, 0, 0, 0, 0, 0)))
    link.clock.sleep(1.5)
    gripper.stop()
    here = gripper.state()
    link.clock.sleep(3.0)
    assert gripper.state() == here
    assert (here.enabled, here.activated) == (False, False)
    assert 3 < here.position_counts < 230
    link, gripper = active()
    link.model.fail(0x0E, link.clock.now())
    gripper.stop()
    assert gripper.state().fault == 0x0E


def test_jaws_that_came_to_rest_while_the_process_was_stopped_have_a_width():
    link, gripper = active()
    gripper.move(255, 0, 0)
    read = link.read

    def stopped_at_its_end():
        block = read()
        if block[0] & 0xC0 == 0xC0:  # at the request
            link.read = read
            link.clock.sleep(60.0)
        return block

    link.read = stopped_at_its_end
    assert gripper.wait().position_counts == 230


@pytest.mark.parametrize(
    ("block", "message"),
    [
        (bytes((0x39, 0, 0, 200, 50, 10)), "not done moving"),  # gOBJ stuck at moving
        (bytes((0xF9, 0, 0, 0, 3, 0)), "not done taking the request"),  # no echo
        (bytes((0x31, 0, 0, 200, 50, 0)), "not done moving"),  # rGTO gone
        (bytes((0x39, 0, 0x0E, 200, 50, 90)), "0x0E"),
        (bytes((0x00, 0, 0, 200, 50, 0)), "not active"),
    ],
)
def test_registers_that_never_finish_end_in_a_fault_within_the_deadline(block, message):
    link, gripper = active()
    gripper.move(200, 255, 0)
    link.frozen = block
    began = link.clock.time
    with pytest.raises(GripperFault, match=message):
        gripper.wait()
    assert link.clock.time - began < 5.0


def test_a_count_that_never_stands_still_is_no_width():
    link, gripper = active()
    gripper.move(200, 255, 0)
    counts = iter(range(100, 10_000))
    link.read = lambda: (link.clock.sleep(TRANSACTION_S), bytes((0xB9, 0, 0, 200, next(counts) % 230, 0)))[1]
    with pytest.raises(GripperFault, match="does not settle"):
        gripper.wait()


def test_the_silence_fault_is_looked_at_twice():
    link, gripper = active()
    link.clock.sleep(5.0)
    assert gripper.state().fault == 0


def test_link_errors_pass():
    link, gripper = active()

    def broken():
        raise LinkError("gone", "virtual")

    link.read = broken
    for call in (gripper.state, gripper.activate, gripper.stop):
        with pytest.raises(LinkError, match="gone"):
            call()


def test_a_request_that_another_program_changes_is_a_fault_and_no_width():
    """Settled, but at somebody else's request: the reading would be taken for an answer to ours."""
    link, gripper = active()
    gripper.move(200, 255, 0)
    ours, theirs = bytes((0xF9, 0, 0, 200, 199, 0)), bytes((0xF9, 0, 0, 120, 199, 0))
    blocks = iter([ours] * 3)
    link.read = lambda: (link.clock.sleep(TRANSACTION_S), next(blocks, theirs))[1]
    with pytest.raises(GripperFault, match="is another program using it"):
        gripper.wait()
    assert len(link.writes) == 1
