"""A world with a plain answer: a 21 mm part that lines up with the fingers and is centred between them."""


class FakeWorld:
    def __init__(self, job, seed):
        self.job, self.seed = job, seed

    def squeeze(self, pose_hand):
        x, _, _ = pose_hand
        return (x, 0.0, 0.0), 21.0, "grasped"

    def collides(self, pose_hand, opening_mm):
        return abs(pose_hand[1]) > opening_mm / 2.0 - 21.0


def make(job, seed):
    return FakeWorld(job, seed)


def broken(job, seed):
    raise RuntimeError("this world\nis broken")


class Stumbling:
    """Works once, to warm up; the next one fails."""

    instances = 0

    def __init__(self):
        Stumbling.instances += 1
        self.fails = Stumbling.instances > 1

    def squeeze(self, pose_hand):
        if self.fails:
            raise RuntimeError("no such squeeze")
        return pose_hand, 0.0, "untouched"


def stumbling(job, seed):
    return Stumbling()


not_callable = 3
