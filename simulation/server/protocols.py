"""Ways to a served plant beside datagrams: each a server in the event loop of one thread."""

import asyncio
import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.simulation.server.plant import ServedPlant


class Protocol(ABC):
    """A server of one protocol, whose clients read and write a plant's registers.

    Attributes:
        host, port: where it listens.
    """

    name: str
    """What it is called."""

    library: str
    """The library it needs; it comes with the extra ``serve``."""

    def __init__(self, host: str, port: int) -> None:
        """Say where it is to listen.

        Raises:
            ConfigurationError: a port that there is not.
            MissingExtraError: its library is not installed.
        """
        if not 1 <= port <= 65535:
            raise ConfigurationError(f"{self.name} port = {port}: must be 1 to 65535")
        try:
            __import__(self.library)
        except ImportError:
            raise MissingExtraError(self.library, "serve") from None
        logging.getLogger(self.library).setLevel(logging.CRITICAL)  # what clients do wrong is answered to them
        self.host, self.port = host, port

    @property
    @abstractmethod
    def address(self) -> str:
        """What clients connect to."""

    @abstractmethod
    async def open(self, plant: ServedPlant) -> None:
        """Begin to serve.

        Raises:
            OSError, RuntimeError: it cannot listen there.
        """

    @abstractmethod
    async def close(self) -> None:
        """End."""


@contextmanager
def served(plant: ServedPlant, protocols: Sequence[Protocol]) -> Iterator[None]:
    """Serve a plant by some protocols, in a thread of their own.

    Raises:
        ConfigurationError: one cannot listen at its address.
    """
    if not protocols:
        yield
        return
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="protocols", daemon=True)
    thread.start()
    with ExitStack() as stack:
        stack.callback(_end, loop, thread)
        for protocol in protocols:
            try:
                asyncio.run_coroutine_threadsafe(protocol.open(plant), loop).result()
            except (OSError, RuntimeError, UnicodeError) as error:
                raise ConfigurationError(f"cannot listen at {protocol.address}: {error}") from error
            stack.callback(lambda protocol=protocol: asyncio.run_coroutine_threadsafe(protocol.close(), loop).result())
        yield


def _end(loop: asyncio.AbstractEventLoop, thread: threading.Thread) -> None:
    async def finish() -> None:
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    asyncio.run_coroutine_threadsafe(finish(), loop).result()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()
