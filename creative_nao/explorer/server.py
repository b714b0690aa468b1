"""Serving the explorer on this machine: who may ask, and what the page asks for. A tab leaves nothing here.

The page works out itself what a movement is and what it is worth; it asks for memories with their maps, finer cells,
performances in physics, recordings that are read, favourites, agents that play, and memories that are trained.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import socket
import tempfile
import threading
import time
import webbrowser
from base64 import b64encode
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import anyio.to_thread
import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from creative_nao.demonstrations import save_demonstrations
from creative_nao.errors import CreativeNaoError, NotFoundError, SettingsError
from creative_nao.exchange import FORMATS, WRITABLE
from creative_nao.exchange.motion import DT_S
from creative_nao.explorer.favourites import Favourite, Session
from creative_nao.explorer.gate import Gate
from creative_nao.explorer.keyframes import KeyframeSet, Rows, boxing, ranges
from creative_nao.explorer.live_agents import agents_for, dots, tries
from creative_nao.explorer.recordings import MAX_TICKS, export, read_upload
from creative_nao.explorer.registry import Computation, LoadedMemory, MemoryRegistry, View, finer_cells, movement
from creative_nao.explorer.robot_service import RobotService
from creative_nao.explorer.run_episodes import RunEpisodes
from creative_nao.explorer.training import Trainer, TrainingSessions
from creative_nao.joints import JOINTS, N_JOINTS
from creative_nao.model import TrainingSettings, condition_settings
from creative_nao.model.config import AUTO
from creative_nao.schema import Field, Text, dump, parse, record

STATIC = Path(__file__).with_name("static")
TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}


def claim_port(host: str, port: int) -> None:
    """Make sure that the port is free; SettingsError if it is not, or may not be used."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingsError(f"port {port} on {host} cannot be used: {reason}; choose another with --port") from error


TAUGHT = "taught:"
"""Begins the name of a memory that is taught in the page; the name of its trainer follows."""
Angles = Annotated[
    tuple[Annotated[tuple[float, ...], Field(min_length=N_JOINTS, max_length=N_JOINTS)], ...],
    Field(min_length=1, max_length=MAX_TICKS),
]
Points = Annotated[tuple[tuple[float, float], ...], Field(min_length=1)]


@record
class MovementRequest:
    """Joint angles [rad] at a tick [s]; for a film its ending, and whether the body performs it."""

    dt: Annotated[float, Field(gt=0, le=1)]
    angles: Angles
    ending: Annotated[str, Field(pattern="gif|mp4")] = "gif"
    physics: bool = False


@record
class ExportRequest:
    """A movement of a memory in a format."""

    memory: Text
    points: Points
    format: Text


@record
class TrainRequest:
    """Demonstrations as rows of keyframes, and how a memory is trained on them; `taught` goes on with a trainer."""

    drafts: Rows
    condition: Literal["open", "half", "closed", "auto"] = "auto"
    epochs: Annotated[int, Field(ge=100, le=300_000)] = 30_000
    seed: Annotated[int, Field(ge=0, le=999_999)] = 0
    taught: Text = ""


class Explorer:
    """What all pages share; `load` gives the memories, and takes a while: pages wait, and say so."""

    def __init__(self, load: Callable[[], MemoryRegistry], session: Session, run: RunEpisodes | None = None) -> None:
        self.session, self.sessions, self.run = session, TrainingSessions(), run
        self._load, self._failure = load, ""
        self._ready = threading.Event()
        self.work = asyncio.Semaphore(2)  # what takes seconds, at a time: the page and its maps stay quick

    def prepare(self, told: Callable[[str], object]) -> None:
        """Load everything, and tell the terminal how it goes."""
        start = time.monotonic()
        slow = threading.Timer(4.0, told, ["compiling, once on this machine: about a minute"])
        slow.daemon = True
        slow.start()
        try:
            self.robot = RobotService()
            self.registry = self._load()
            if self.run is not None:
                self.run.check(self.registry.first.memory)
            self.registry.start()
        except Exception as error:  # the page has to say so
            self._failure = str(error)
            if not isinstance(error, CreativeNaoError):
                raise
            told(f"error: {error}")
            return
        finally:
            slow.cancel()
            self._ready.set()
        told(f"ready after {time.monotonic() - start:.1f} s")

    def memory(self, name: str) -> LoadedMemory:
        """Return a memory by the name that the page has for it; NotFoundError if there is none."""
        if name.startswith(TAUGHT):
            return self.sessions.get(name.removeprefix(TAUGHT)).loaded()
        return self.registry.get(name)

    def routes(self) -> list[Route]:
        """Return what may be asked for."""
        reads: dict[str, Callable[..., Any]] = {
            "memory": self.get_memory, "robot": lambda _: self.robot.robot.description, "agent": self.get_agent,
            "favourites": self.get_favourites, "keyframes": self.get_keyframes,
        }  # fmt: skip
        writes: dict[str, Callable[..., Any]] = {
            "perform": self.perform, "film": self.film, "export": self.export, "read": self.read,
            "favourites": self.keep, "keyframes": self.check_keyframes, "train": self.train, "csv": self.csv,
        }  # fmt: skip
        return [
            Route("/", page), Route("/teach", page), Route("/static/{name}", static),
            Route("/api/state", self.state), Route("/api/cells", self.cells),
            Route("/api/taught/{name}", self.taught, methods=["GET", "POST"]),
            *(Route(f"/api/{name}", self._answers(call)) for name, call in reads.items()),
            *(Route(f"/api/{name}", self._answers(call), methods=["POST"]) for name, call in writes.items()),
            Route("/api/favourites", self._answers(self.forget), methods=["DELETE"]),
        ]  # fmt: skip

    def _answers(self, call: Callable[..., Any]) -> Callable[[Request], Awaitable[Response]]:
        """Answer by a function of the query and, if there is one, the body, called in a thread."""

        async def answer(request: Request) -> Response:
            query = dict(request.query_params)
            body = await request.body()
            slow = call in (self.perform, self.film, self.get_agent, self.read)
            async with self.work if slow else contextlib.nullcontext():
                return await _told(call, query, *([body] if request.method != "GET" else []))

        return answer

    async def state(self, _: Request) -> Response:
        """Answer at once, also while all else waits."""
        if not self._ready.is_set():
            return JSONResponse({"ready": False})
        if self._failure:
            return JSONResponse({"error": self._failure}, 500)
        registry = self.registry
        return JSONResponse(
            {
                "ready": True, "first": registry.first.name, "names": list(registry.names), "beside": registry.beside,
                "formats": [[name, f"{name}: {FORMATS[name].purpose}"] for name in WRITABLE],
            }
        )  # fmt: skip

    def get_memory(self, query: dict[str, str]) -> dict[str, Any]:
        """Return all that the page needs of a memory."""
        loaded = self.memory(query.get("name", ""))
        told = {"agents": agents_for(loaded.memory, self.run), "dots": dots(loaded.memory, self.run)}
        return loaded.page_json() | told

    async def cells(self, request: Request) -> Response:
        """Return the map in a colouring or, with a window, finer cells; a page that asks no more ends the work."""
        query, work = dict(request.query_params), Computation()

        def compute() -> dict[str, Any] | None:
            loaded, colour = self.memory(query.get("name", "")), query.get("colour", "")
            if "width" not in query:
                return loaded.cells(colour)
            try:
                view = View(*(float(query.get(side, "")) for side in ("left", "bottom", "width")))
                n = int(query.get("n", ""))
            except ValueError as error:
                raise SettingsError(f"a window is three numbers and its cells: {error}") from None
            if not 2 <= n <= 200:
                raise SettingsError(f"`n` should be from 2 to 200, but is {n}")
            return finer_cells(loaded.memory, loaded.pb_map, view, n, colour, work)

        async with self.work:
            if await request.is_disconnected():
                return Response(status_code=499)
            answer = asyncio.create_task(_told(compute))
            while not (await asyncio.wait([answer], timeout=0.1))[0]:
                work.cancelled = work.cancelled or await request.is_disconnected()
            return answer.result()

    def perform(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Perform a movement in physics."""
        asked = parse(MovementRequest, body, "movement")
        return self.robot.perform(np.array(asked.angles), asked.dt)

    def film(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Draw a movement."""
        asked = parse(MovementRequest, body, "movement")
        content = self.robot.film(np.array(asked.angles), asked.dt, asked.ending, asked.physics)
        return {"name": f"movement.{asked.ending}", "content": b64encode(content).decode()}

    def export(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Write a movement of a memory in one of the exchange formats."""
        asked = parse(ExportRequest, body, "export")
        memory = self.memory(asked.memory).memory
        trajectory = movement(memory, np.array(asked.points))
        name, content, changes = export(memory, asked.points, trajectory, asked.format)
        return {"name": name, "content": b64encode(content).decode(), "changes": list(changes)}

    def read(self, query: dict[str, str], body: bytes) -> dict[str, Any]:
        """Read a recording, and find the PB point of a memory nearest to its first movement, unless none is named."""
        name = query.get("memory", "")
        memory = self.memory(name).memory if name else None
        recordings = read_upload(query.get("name", ""), body, DT_S if memory is None else memory.dt_s)
        told: dict[str, Any] = {
            "dt": recordings[0].motion.dt_s,
            "movements": [
                {"name": one.place, "angles": one.motion.angles.tolist(), "notes": list(one.notes)}
                for one in recordings
            ],
        }
        if memory is None:
            return told
        found = memory.infer_pb(recordings[0].motion.angles)
        return told | {"pb": found.pb.tolist(), "error": float(found.error)}

    def get_agent(self, query: dict[str, str]) -> dict[str, Any]:
        """Let an agent play an episode."""
        seed = query.get("seed", "0")
        if not (seed.isdigit() and len(seed) < 7):
            raise SettingsError(f"`seed` should be a whole number below a million, but is {seed!r:.40}")
        return tries(self.memory(query.get("memory", "")).memory, query.get("name", ""), int(seed), self.run)

    def get_favourites(self, query: dict[str, str]) -> list[dict[str, Any]]:
        """Return the favourites of a memory, named by its content hash."""
        return [dump(one) for one in self.session.favourites(query.get("key", ""))]

    def keep(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Keep a favourite."""
        self.session.add(parse(Favourite, body, "favourite"))
        return {}

    def forget(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Forget a favourite."""
        self.session.remove(parse(Favourite, body, "favourite"))
        return {}

    def get_keyframes(self, _: dict[str, str]) -> dict[str, Any]:
        """Return the boxing set to begin with, and the joints with their ranges."""
        return {"drafts": json.loads(boxing().to_text()), "joints": list(JOINTS), "ranges": ranges()}

    def check_keyframes(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Return the movements of demonstrations, and what is wrong or could be better."""
        return KeyframeSet.from_rows(parse(Rows, body, "key postures")).as_json()

    def csv(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Return a ZIP archive of CSV files that `creative-nao train --demonstrations` takes unpacked."""
        demonstrations = KeyframeSet.from_rows(parse(Rows, body, "key postures")).demonstrations()
        with tempfile.TemporaryDirectory() as folder:
            save_demonstrations(Path(folder) / "demonstrations", demonstrations)
            archive = shutil.make_archive(f"{folder}/made", "zip", folder, "demonstrations")
            return {"name": "demonstrations.zip", "content": b64encode(Path(archive).read_bytes()).decode()}

    def train(self, _: dict[str, str], body: bytes) -> dict[str, Any]:
        """Begin a training, or go on with one; return the name of its trainer."""
        asked = parse(TrainRequest, body, "training")
        if asked.taught:
            trainer = self.sessions.get(asked.taught)
            done, ended = trainer.progress.epoch, trainer.progress.phase == "finished"
            trainer.learn(done + asked.epochs if ended else trainer.progress.n_epochs)
            return {"taught": asked.taught}
        keyframes = KeyframeSet.from_rows(asked.drafts)
        if faults := keyframes.shortcomings():
            raise SettingsError(faults[0])
        chosen = AUTO if asked.condition == "auto" else condition_settings(asked.condition, {})
        training = TrainingSettings(seed=asked.seed, **chosen)
        trainer = Trainer(keyframes.demonstrations(), training, self.sessions.concurrency_limit)
        name = self.sessions.add(trainer)
        trainer.learn(asked.epochs)
        return {"taught": name}

    async def taught(self, request: Request) -> Response:
        """Return how far a training is, and keep it alive; POST stops it, `?file=1` gives the memory as a file."""
        name, query = request.path_params["name"], request.query_params

        def answer() -> dict[str, Any]:
            trainer = self.sessions.get(name)
            if request.method == "POST":
                trainer.stop()
            if "file" not in query:
                return trainer.as_json() if "map" in query else {"phase": trainer.progress.phase}
            with tempfile.TemporaryDirectory() as folder:
                path = trainer.loaded().memory.save(Path(folder) / "taught.safetensors")
                return {"name": path.name, "content": b64encode(path.read_bytes()).decode()}

        return await _told(answer)


async def _told(call: Callable[..., Any], *arguments: Any) -> Response:
    try:
        return JSONResponse(await anyio.to_thread.run_sync(call, *arguments))
    except (CreativeNaoError, OSError) as error:
        return JSONResponse({"error": str(error)}, 404 if isinstance(error, NotFoundError) else 400)


async def page(_: Request) -> Response:
    """Return the page, which is the same at every address."""
    return _file("index.html")


async def static(request: Request) -> Response:
    """Return a part of the page."""
    name = request.path_params["name"]
    return _file(name) if name in {path.name for path in STATIC.iterdir()} else Response(status_code=404)


def _file(name: str) -> Response:
    path = STATIC / name
    return Response(path.read_bytes(), media_type=TYPES[path.suffix], headers={"cache-control": "no-cache"})


SWEEP_S = 5.0


def application(explorer: Explorer, host: str, allowed: tuple[str, ...], started: Callable[[], object]) -> ASGIApp:
    """Return the server as an ASGI application; `started` is called when it begins to answer."""

    async def sweep() -> None:
        while True:
            await asyncio.sleep(SWEEP_S)
            explorer.sessions.sweep()

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        started()
        sweeping = asyncio.create_task(sweep())
        yield
        sweeping.cancel()

    return Gate(Starlette(routes=explorer.routes(), lifespan=lifespan), host, allowed)


def serve(
    explorer: Explorer,
    *,
    host: str,
    port: int,
    show: bool,
    allowed: tuple[str, ...] = (),
    told: Callable[[str], object] = lambda _: None,
) -> None:
    """Serve until Ctrl-C, and `show` the page; only with a `host` other than 127.0.0.1 can other machines reach it.

    `allowed` are names by which it may be asked for besides this machine's own and `host`; `told` takes a line for the
    terminal.
    """

    def started() -> None:
        threading.Thread(target=explorer.prepare, args=(told,), name="prepare", daemon=True).start()
        if show:
            threading.Timer(0.3, webbrowser.open, [f"http://{host}:{port}/"]).start()

    settings = uvicorn.Config(
        application(explorer, host, allowed, started), host=host, port=port, log_level="warning", ws="none",
        limit_concurrency=500, timeout_keep_alive=20, timeout_graceful_shutdown=2, server_header=False,
    )  # fmt: skip
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(settings).run()
