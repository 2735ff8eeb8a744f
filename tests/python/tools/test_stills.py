"""The pictures of docs/own-world.md."""

import numpy as np
import pytest

from flockstep.pictures import third_person_view
from tools import stills


@pytest.mark.parametrize("name", ["forest", "office"])
def test_the_drone_is_shown_on_its_way(name, monkeypatch):
    """The trail is blue, and the rest of the picture does not depend on it."""
    image = stills.fly(stills.FLIGHTS[name], (160, 90)).astype(int)
    monkeypatch.setattr(third_person_view.ThirdPersonView, "_draw_trail", lambda *_: None)
    without = stills.fly(stills.FLIGHTS[name], (160, 90)).astype(int)
    trail = (image != without).any(axis=-1)
    assert trail.any()
    r, g, b = np.median(image[trail], axis=0)
    assert b > max(r, g)
