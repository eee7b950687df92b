"""The three displacement histories of Pekedis (2025), section 2.1, for a specimen of any gauge length."""

import numpy as np

from sinew.tasks.model.specimen import Protocol

STRAIN_RATE = 0.006  # 1/s
HOLD_S = 200.0


def one_step(length_mm: float, rate_hz: float = 100.0) -> Protocol:
    """Ramp to 4 % strain, then hold for 200 s."""
    return _through("one_step", length_mm, rate_hz, [(0.04, HOLD_S)])


def two_step(length_mm: float, rate_hz: float = 100.0) -> Protocol:
    """Two ramps of 2 % strain, each followed by 200 s of hold."""
    return _through("two_step", length_mm, rate_hz, [(0.02, HOLD_S), (0.04, HOLD_S)])


def cyclic(length_mm: float, rate_hz: float = 100.0) -> Protocol:
    """Load and unload to 2, 2.2, ... 4.2 % strain, twelve cycles."""
    peaks = 0.02 + 0.002 * np.arange(12)
    return _through("cyclic", length_mm, rate_hz, [corner for peak in peaks for corner in ((peak, 0.0), (0.0, 0.0))])


STANDARD = (one_step, two_step, cyclic)


def _through(name: str, length_mm: float, rate_hz: float, corners: list[tuple[float, float]]) -> Protocol:
    """Move at the strain rate to each corner (strain, hold in s) in turn."""
    times, strains = [0.0], [0.0]
    for strain, hold_s in corners:
        times.append(times[-1] + abs(strain - strains[-1]) / STRAIN_RATE)
        strains.append(strain)
        if hold_s:
            times.append(times[-1] + hold_s)
            strains.append(strain)
    time_s = np.arange(int(np.floor(times[-1] * rate_hz + 1e-9)) + 1) / rate_hz
    return Protocol(name, time_s, length_mm * np.interp(time_s, times, strains))
