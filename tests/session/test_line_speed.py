"""A scan mode that sends more than the line carries is refused, whichever of the two is chosen last."""

import math
from dataclasses import replace

import pytest

from lidario import InvalidValue, Unsupported
from lidario.basics.source import parse_source
from lidario.families.registry import FAMILIES
from lidario.families.rplidar.device import RplidarDevice
from lidario.session.finding.connect import connect
from lidario.session.streaming.modes import does_not_fit
from tests.support.devices import Rig, names, scanning


@pytest.mark.parametrize("scanning", [False, True])
async def test_a_speed_that_does_not_fit_the_mode_is_refused(rplidar: Rig, *, scanning: bool) -> None:
    async with rplidar.open() as lidar:
        stream = lidar.scans()
        if scanning:
            await anext(stream)
        # 32000 samples a second, 40 of them in 84 bytes; a start bit, eight data bits, a stop bit.
        with pytest.raises(InvalidValue, match=r"'DenseBoost' sends 67200 bytes.* carries 25600.* 672000 baud"):
            await lidar.set_baudrate(256_000)
        for wrong in (9599, 4_000_001):
            with pytest.raises(InvalidValue, match=f"{wrong} is no speed from 9600 to 4000000 baud"):
                await lidar.set_baudrate(wrong)
        assert lidar.stats.interruptions == 0
        assert (lidar.baudrate, rplidar.device.baudrate) == (1_000_000, 1_000_000)
        assert len(await anext(stream)) > 3000
        await lidar.set_baudrate(672_000)
        assert len(await anext(stream)) > 3000
    assert names(rplidar, obeyed=True).count("new_baudrate_confirm") == 1


async def test_a_device_found_at_too_slow_a_speed_says_so(rplidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another program left it so. It can be asked, and set to a speed at which it can scan."""
    with monkeypatch.context() as patch:
        patch.setattr(RplidarDevice, "load", lambda device, mode: math.nan)
        async with rplidar.open() as lidar:
            await lidar.set_baudrate(256_000)
    assert rplidar.device.baudrate == 256_000
    async with rplidar.open(baudrate=256_000) as lidar:
        assert (await lidar.get_health()).ok
        for _ in range(2):
            with pytest.raises(Unsupported, match="'DenseBoost' sends 67200 bytes"):
                await lidar.scan()
        await lidar.set_baudrate(1_000_000)
        assert len(await lidar.scan()) > 3000


@pytest.mark.parametrize("rig", ["rplidar-c1"], indirect=True)
async def test_a_mode_that_does_not_fit_is_refused_beside_one_that_does(rig: Rig) -> None:
    async with rig.open() as lidar:
        async with scanning(lidar, "Standard") as stream:
            # The mode that runs decides, not the typical one.
            with pytest.raises(InvalidValue, match="'Standard' sends 25000"):
                await lidar.set_baudrate(115_200)
            assert lidar.stats.interruptions == 0
            assert len(await anext(stream)) > 100
        await lidar.stop()
        # The typical mode, which is asked for where none is, fits.
        await lidar.set_baudrate(115_200)
        with pytest.raises(Unsupported, match=r"'Standard' sends 25000 .* or choose 'DenseBoost'"):
            await lidar.scan("Standard")
        assert not (await lidar.scan()).lost_packets


MODELS = [(family.name, model) for family in FAMILIES for model in family.simulated]


@pytest.mark.exhaustive("which", sample=MODELS[::6], full=MODELS)
async def test_each_mode_of_each_model_fits_its_own_line(which: tuple[str, str]) -> None:
    family, model = which
    found = await connect(parse_source(f"sim://{model}?via=memory"), family)
    modes = await found.dialogue.run(found.dialogue.device.modes())
    for mode in modes:
        assert does_not_fit(found.dialogue.device, modes, mode, found.dialogue.port.baudrate) == ""
    await found.dialogue.close()


async def test_of_a_mode_of_which_nothing_is_known_nothing_is_said() -> None:
    """It is neither refused nor recommended."""
    found = await connect(parse_source("sim://rplidar-s2?via=memory"), "rplidar")
    mode, *_ = await found.dialogue.run(found.dialogue.device.modes())
    for unknown in (replace(mode, sample_us=0.0), replace(mode, response_type=0x99)):
        assert does_not_fit(found.dialogue.device, (mode, unknown), unknown, 9600) == ""
        assert "choose" not in does_not_fit(found.dialogue.device, (mode, unknown), mode, 9600)
        assert "9600 baud" in does_not_fit(found.dialogue.device, (mode, unknown), mode, 9600)
    await found.dialogue.close()
