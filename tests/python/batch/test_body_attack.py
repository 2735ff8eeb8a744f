"""A share of `./dev try attacks`: random calls of `batch.bodies`, many of them invalid."""

import pytest

import body_attack


@pytest.mark.parametrize("seed", [0, 100, 200])
def test_random_calls_break_nothing(seed):
    counts = body_attack.run(600, seed)
    assert counts["refused"] > 100
    for call in ("spawn", "set_pose", "set_velocity", "remove", "fly", "restore", "remove_all", "check_twin"):
        assert counts[f"accepted {call}"] > 0, call


def test_a_refused_call_that_changes_something_is_found():
    attack = body_attack.Attack(0)

    def bad_call():
        attack.batch.bodies.spawn(attack.valid_body())
        raise ValueError

    attack.batch.bodies.remove()
    attack.spawn = bad_call
    with pytest.raises(AssertionError, match=r"a refused bad_call changed .*active"):
        call_often(attack)


def call_often(attack):
    for _ in range(100):
        attack.call()
