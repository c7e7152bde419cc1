"""What is used by ``with`` or ``async with``, and what is refused: the wrong one of them, and copies."""

from abc import ABC, abstractmethod
from typing import ClassVar, NoReturn, Self

from lidario.errors import LocalProtocolError


class Held:
    """Base of what holds a device, a thread or a file, and lives in one process."""

    __slots__ = ()

    def __reduce__(self) -> NoReturn:
        raise LocalProtocolError(
            f"a {type(self).__name__} cannot be copied or sent to another process: send its scans"
        )


class AsyncOnly:
    """Base of what a plain ``with`` or ``for`` cannot use."""

    __slots__ = ()

    _instead: ClassVar[str]
    """What to write instead, as a sentence."""

    def __enter__(self) -> NoReturn:
        raise LocalProtocolError(self._instead)

    def __exit__(self, *_: object) -> None:
        """Never reached; `with` looks for it before `__enter__` can say what to write."""

    def __iter__(self) -> NoReturn:
        raise LocalProtocolError(self._instead)


class Entered(AsyncOnly, Held, ABC):
    """Base of what has `start` and `close`, and is used as an asynchronous context manager."""

    @abstractmethod
    async def start(self) -> None:
        """Begin; ``async with`` does so."""

    @abstractmethod
    async def close(self) -> None:
        """End. Harmless when done before."""

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


class Closing(Held, ABC):
    """Base of what is closed at the end of its ``with`` block."""

    @abstractmethod
    def close(self) -> None:
        """End. Harmless when done before."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
