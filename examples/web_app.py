"""A web application with a lidar: FastAPI, one session for all requests.

    pip install fastapi uvicorn
    LIDAR=auto uvicorn web_app:app

A whole page that draws scans is there already: lidario view. This is for an application of your own.
"""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

from fastapi import FastAPI, HTTPException
from fastapi.responses import HTMLResponse

import lidario

TOO_OLD_S = 1.0
PAGE = """<!doctype html><title>Nearest</title><h1 id=at>…</h1><script>
setInterval(async () => {
  const answer = await fetch("nearest"), nearest = await answer.json()
  document.getElementById("at").textContent =
    !answer.ok ? nearest.detail : nearest ? nearest.range.toFixed(2) + " m" : "nothing in sight"
}, 200)</script>"""


@asynccontextmanager
async def lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Open the lidar when the server starts, and leave it still when it ends."""
    source = getattr(app.state, "source", None) or os.environ.get("LIDAR", "auto")
    app.state.scan = None
    async with lidario.open_lidar(source, reconnect=True) as lidar:

        async def watch() -> None:
            async for scan in lidar.scans():
                app.state.scan = scan

        app.state.watching = watching = asyncio.create_task(watch())
        yield
        watching.cancel()
        with suppress(asyncio.CancelledError):
            await watching


app = FastAPI(lifespan=lifespan)


def latest() -> lidario.Scan:
    """The latest scan; 503 where there is none of this moment, so that nobody acts on an old one."""
    scan: lidario.Scan | None = app.state.scan
    if app.state.watching.done():
        raise HTTPException(503, f"the lidar is gone: {app.state.watching.exception()}")
    if scan is None:
        raise HTTPException(503, "no scan yet")
    if asyncio.get_running_loop().time() - scan.stamp_ns * 1e-9 > TOO_OLD_S:
        raise HTTPException(503, "no scan lately: is the lidar connected?")
    return scan


@app.get("/", response_class=HTMLResponse)
async def page() -> str:
    """A page that shows the nearest distance."""
    return PAGE


@app.get("/nearest")
async def nearest() -> dict[str, float] | None:
    """The nearest return of the latest scan: metres, and radians counter-clockwise."""
    found = latest().nearest()
    return {"range": found.range, "angle": found.angle} if found else None


@app.get("/scan")
async def scan() -> dict[str, Any]:
    """All of the latest scan."""
    return latest().to_dict()
