"""What is used by ``async with``: it starts there, and is closed behind it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import ClassVar, NoReturn, Self

from lidario.errors import LocalProtocolError

__all__ = ["Entered"]


class Entered(ABC):
    """Base of what has `start` and `close`, and is used as an asynchronous context manager."""

    how: ClassVar[str]
    """What to write instead of ``with``, as a sentence."""

    @abstractmethod
    async def start(self) -> None:
        """Begin; ``async with`` does so."""

    @abstractmethod
    async def close(self) -> None:
        """End. Harmless when done before."""

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def __enter__(self) -> NoReturn:
        raise LocalProtocolError(self.how)

    def __exit__(self, *_: object) -> None:  # noqa: B027 - never reached
        """Never reached; `with` looks for it before `__enter__` can say what to write."""
