"""A battery that was charged is told from one that recovers while the robot rests."""

from homeward.watch.online.charge import Charge


def test_a_charge_is_told_from_a_battery_that_recovers() -> None:
    charge = Charge()
    assert [charge.see(soc) for soc in (0.30, 0.28, 0.33, 0.29, 0.37)] == [False] * 5
    assert [charge.see(soc) for soc in (0.41, 0.42, 0.42, 0.60)] == [True, True, False, True]
    assert [charge.see(soc) for soc in (0.60, 0.59, 0.60, 0.61)] == [False, False, False, True]
    assert [charge.see(soc) for soc in (0.59, 0.60, 0.62, 0.68)] == [False] * 4
