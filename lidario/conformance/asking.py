"""Rules about questions: what a device at rest responds, and how soon."""

from lidario.basics.model import HealthStatus
from lidario.conformance.bench import Bench
from lidario.conformance.rule import Broken, Need, NotTried, Origin, known

QUESTIONS = 5


@known(
    Origin.MANUAL,
    "the times of requests and responses; where the manual tells none, those of the vendor's SDK",
    Need.ANSWERS,
)
async def identity_in_time(bench: Bench) -> str:
    """It says what it is, each response within the time of its request."""
    info, times = await bench.ask(bench.dialogue.device.identify())
    bench.measured("response to what it is", 1e3 * max(times.values()), "ms")
    return f"{info.model}; {_longest(times)}"


@known(Origin.MANUAL, "health request", Need.ANSWERS)
async def health_in_time(bench: Bench) -> str:
    """It says how it is, each response within the time of its request, and reports no error."""
    # This also sets a control line, where the device is dark without.
    await bench.ask(bench.dialogue.device.identify())
    health, times = await bench.ask(bench.dialogue.device.health())
    if health.status is not HealthStatus.OK:
        raise Broken(f"health is {health.status.value}, code {health.code}. {health.note}".strip())
    bench.measured("response to how it is", 1e3 * max(times.values()), "ms")
    return _longest(times)


@known(Origin.MANUAL, "device information request", Need.ANSWERS)
async def identity_is_one(bench: Bench) -> str:
    """It says the same of itself however often it is asked."""
    for _ in range(QUESTIONS):
        info, _times = await bench.ask(bench.dialogue.device.identify())
        if info != bench.lidar.info:
            raise Broken(f"it was a {bench.lidar.info.model}, and now says {info}")
    return f"{QUESTIONS} times"


@known(Origin.MANUAL, "one request at a time", Need.ANSWERS)
async def questions_in_a_row(bench: Bench) -> str:
    """A request right behind the response before is answered, as soon as the first one."""
    request = bench.question()
    assert request is not None
    # This also sets a control line, where the device is dark without.
    await bench.ask(bench.dialogue.device.identify())
    times = [await bench.ask_once(request) for _ in range(2 * QUESTIONS)]
    bench.measured("longest response", 1e3 * max(times), "ms")
    return f"{len(times)} questions, {max(times) * 1e3:.0f} ms at most"


@known(Origin.MANUAL, "states: idle", Need.STOPS)
async def silent_at_rest(bench: Bench) -> str:
    """A device that was not started sends nothing."""
    await bench.rest()
    return await bench.is_silent()


@known(Origin.MANUAL, "scan modes")
async def modes_are_listed(bench: Bench) -> str:
    """It lists its scan modes, each once."""
    modes, _times = await bench.ask(bench.dialogue.device.modes())
    names = [mode.name for mode in modes]
    if len(set(names)) < len(names):
        raise Broken(f"a mode is listed twice: {', '.join(names)}")
    return ", ".join(names)


@known(Origin.MANUAL, "scan frequency, or motor speed", Need.SPEED)
async def speed_within_range(bench: Bench) -> str:
    """The scan frequency that it tells lies between the slowest and the fastest one."""
    (slowest, fastest), _times = await bench.ask(bench.dialogue.device.scan_frequency_range())
    if not 0 < slowest < fastest:
        raise Broken(f"the range is from {slowest:g} to {fastest:g} Hz")
    hertz, _times = await bench.ask(bench.dialogue.device.scan_frequency())
    if not hertz:
        raise NotTried("it tells no scan frequency before it was started")
    if not slowest <= hertz <= fastest:
        raise Broken(f"{hertz:g} Hz is not between {slowest:g} and {fastest:g} Hz")
    return f"{hertz:g} Hz, from {slowest:g} to {fastest:g} Hz"


def _longest(times: dict[str, float]) -> str:
    name = max(times, key=lambda each: times[each])
    return f"{times[name] * 1e3:.0f} ms at most, {name}"
