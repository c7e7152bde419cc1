"""A web application with a lidar: FastAPI, one session for all requests.

    pip install fastapi uvicorn
    LIDAR=auto uvicorn web_app:app

A whole page that draws scans is there already: lidario view. This is for an application of your own.
"""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, HTTPException
from fastapi.responses import HTMLResponse

import lidario

PAGE = """<!doctype html><title>Nearest</title><h1 id=at>…</h1><script>
setInterval(async () => {
  const nearest = await (await fetch("nearest")).json()
  document.getElementById("at").textContent = nearest ? nearest.range.toFixed(2) + " m" : "nothing in sight"
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

        watching = asyncio.create_task(watch())
        yield
        watching.cancel()


app = FastAPI(lifespan=lifespan)


@app.get("/", response_class=HTMLResponse)
def page() -> str:
    """A page that shows the nearest distance."""
    return PAGE


@app.get("/nearest")
def nearest() -> dict[str, float] | None:
    """The nearest return of the latest scan: metres, and radians counter-clockwise."""
    scan: lidario.Scan | None = app.state.scan
    if scan is None:
        raise HTTPException(503, "no scan yet")
    found = scan.nearest()
    return {"range": found.range, "angle": found.angle} if found else None
