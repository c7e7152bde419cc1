"""Rules about the end of a stream: STOP, RESET, and what the session promises of them."""

import asyncio
from contextlib import suppress

from lidario.conformance.bench import Bench
from lidario.conformance.rule import Broken, Need, Origin, known
from lidario.errors import ResponseTimeout

HELD_BACK_S = 0.06
"""How late bytes may come that were sent in time: a USB adapter holds them for 16 ms, a network for some more."""
LISTEN_S = 0.5
FLOW_S = 0.2
"""How long packets flow before the stop."""
RESTARTS = 3
LATER_S = 1.0
"""A start that is not heard is asked for again after two seconds; rotors need more or less by some tenths."""


@known(Origin.MANUAL, "STOP", Need.STOPS)
async def stop_ends_stream(bench: Bench) -> str:
    """STOP ends the stream, within the pause that the manual demands behind it."""
    dialogue = bench.dialogue
    stop = dialogue.device.stop()
    # Of a device that hears no STOP, DTR ends the stream.
    requests = (stop,) if stop.data else (stop, *dialogue.device.halt())
    await bench.flow(await bench.typical())
    await asyncio.sleep(FLOW_S)
    dialogue.deliver_to(None)
    began = bench.now()
    dialogue.write(requests)
    await asyncio.sleep(LISTEN_S)
    took = max(0.0, bench.last_in - began)
    bench.measured("last bytes behind STOP", 1e3 * took, "ms")
    limit = max(request.settle for request in requests) + HELD_BACK_S
    if took > limit:
        raise Broken(f"{took * 1e3:.0f} ms behind STOP bytes still came, not {limit * 1e3:.0f} ms at most")
    return f"last bytes {took * 1e3:.0f} ms behind STOP"


@known(Origin.MANUAL, "STOP", Need.STOPS, Need.ANSWERS)
async def request_after_stop(bench: Bench) -> str:
    """A request is answered right behind the pause that the manual demands behind STOP."""
    stop, question = bench.dialogue.device.stop(), bench.question()
    assert question is not None
    await bench.flow(await bench.typical())
    await asyncio.sleep(FLOW_S)
    bench.dialogue.deliver_to(None)
    bench.dialogue.write((stop,))
    began = bench.now()
    try:
        await bench.ask_once(question)
    except ResponseTimeout:
        raise Broken(f"no response to {question.name} {stop.settle * 1e3:.0f} ms behind STOP") from None
    took_ms = 1e3 * (bench.now() - began)
    bench.measured("response behind STOP", took_ms, "ms")
    return f"asked {stop.settle * 1e3:.0f} ms behind STOP, answered {took_ms:.0f} ms behind it"


@known(Origin.MANUAL, "STOP; states: idle", Need.STOPS, Need.ANSWERS)
async def stop_at_rest(bench: Bench) -> str:
    """STOP to a device at rest does no harm: the next request is answered."""
    await bench.rest()
    bench.dialogue.write((bench.dialogue.device.stop(),))
    _info, times = await bench.ask(bench.dialogue.device.identify())
    return f"answered in {max(times.values()) * 1e3:.0f} ms"


@known(Origin.PROMISE, "what you can rely on: the motor stopped at the end", Need.STOPS, Need.ANSWERS)
async def stop_while_asking(bench: Bench) -> str:
    """A program that stops while it asks leaves the device still, and the next question is answered."""
    async with bench.lidar.scans(depth=1) as scans:
        await anext(scans)
        asking = asyncio.ensure_future(bench.lidar.get_health())
        try:
            await asyncio.sleep(0.001)
            began = bench.now()
            await bench.lidar.stop()
        finally:
            asking.cancel()
            with suppress(Exception, asyncio.CancelledError):
                await asking
    took = bench.now() - began
    await bench.is_silent()
    await bench.lidar.get_info()
    bench.measured("stop while it is asked", took, "s")
    return f"still after {took:.2f} s"


@known(Origin.PROMISE, "what you can rely on: several tasks at once", Need.STOPS, Need.ANSWERS)
async def question_in_stream(bench: Bench) -> str:
    """A question in the midst of a stream is answered, and the stream goes on by itself."""
    longest = 0.0
    async with bench.lidar.scans(depth=1) as scans:
        for _ in range(2):
            await anext(scans)
            began = bench.now()
            await bench.lidar.get_info()
            await anext(scans)
            longest = max(longest, bench.now() - began)
    bench.measured("no scan around a question", longest, "s")
    return f"{longest:.2f} s without a scan"


@known(Origin.MANUAL, "scan requests, STOP", Need.STOPS, limit_s=40.0)
async def starts_again(bench: Bench) -> str:
    """A stream starts again each time after it was stopped, as soon as the first time."""
    took = list[float]()
    await asyncio.sleep(LISTEN_S)  # the first one is not asked for right behind a STOP
    for _ in range(RESTARTS):
        began = bench.now()
        await bench.lidar.scan()
        took.append(bench.now() - began)
        await bench.lidar.stop()
    bench.measured("scan behind a start", max(took), "s")
    times = ", ".join(f"{each:.2f} s" for each in took)
    if max(took[1:]) > took[0] + LATER_S:
        raise Broken(f"scans came after {times}: the start was not heard at once")
    return f"scans after {times}"


@known(Origin.MANUAL, "RESET", Need.RESETS, Need.ANSWERS, limit_s=30.0)
async def reset_boots(bench: Bench) -> str:
    """After RESET it answers within the time that it may take to boot, and is the same device."""
    before = bench.lidar.info
    began = bench.now()
    try:
        await bench.lidar.reset()
    except ResponseTimeout as error:
        limit = bench.dialogue.timing.boot_s
        raise Broken(f"no response within {limit:g} s: {error}") from None
    took = bench.now() - began
    after = await bench.lidar.get_info()
    if after != before:
        raise Broken(f"it was {before}, and came back as {after}")
    bench.measured("boot", took, "s")
    return f"answered {took:.2f} s behind RESET"


@known(Origin.PROMISE, "what you can rely on: several tasks at once", Need.RESETS, Need.ANSWERS, limit_s=30.0)
async def reset_in_stream(bench: Bench) -> str:
    """A device that is restarted in the midst of a stream boots, and its stream goes on by itself."""
    async with bench.lidar.scans(depth=1) as scans:
        await anext(scans)
        began = bench.now()
        await bench.lidar.reset()
        await anext(scans)
        took = bench.now() - began
        bench.measured("no scan around RESET", took, "s")
        return f"{took:.2f} s without a scan"


@known(Origin.PROMISE, "what you can rely on: the motor stopped at the end", Need.STOPS)
async def stands_at_the_end(bench: Bench) -> str:
    """The stop requests leave laser and motor off: no byte comes, and a simulated motor is off."""
    await bench.lidar.scan()
    await bench.rest()
    text = await bench.is_silent()
    simulated = bench.simulated
    if simulated is not None and (simulated.motor_on or simulated.scanning):
        raise Broken("the motor goes on")
    return text
