"""Figures of several runs keep their least and greatest value."""

import timing


def test_a_median_keeps_the_least_and_the_greatest_through_products_and_quotients():
    seconds = timing.Median([2.0, 8.0, 4.0])
    made = timing.figure("rate", 16 / seconds, "1/s", 3, mode="fast")
    assert made == {"name": "rate", "value": 4, "unit": "1/s", "runs": 3, "least": 2, "greatest": 8, "mode": "fast"}
    assert list(made) == ["name", "value", "unit", "runs", "least", "greatest", "mode"]
    made = timing.figure("time", 1e6 * seconds / 2, "us", 3)
    assert (made["value"], made["least"], made["greatest"]) == (2e6, 1e6, 4e6)
    ratio = timing.median_ratio([1.0, 4.0, 3.0], [2.0, 2.0, 1.0])
    assert (ratio, ratio.least, ratio.greatest) == (2, 0.5, 3)


def test_a_single_value_has_no_spread():
    assert timing.figure("count", 12345.6, "1", 1) == {"name": "count", "value": 12350, "unit": "1", "runs": 1}
