"""The web application: addresses and their functions."""

from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
from fastapi import FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_write_error
from toolkit.imaging.read import encode_image, read_image
from toolkit.rooms.photos.studio.describe import describe_inspection, describe_place, describe_session
from toolkit.rooms.photos.studio.ghost import GhostRenderer
from toolkit.rooms.photos.studio.predictor import Predictor
from toolkit.rooms.photos.studio.serve import Access, Guard
from toolkit.rooms.photos.studio.session import NOT_FOUND, Session, undo_keep
from toolkit.rooms.photos.studio.upload import MOST_BYTES, Refused, receive_file

PREVIEW_PX, THUMB_PX = 1280, 240
QUALITY = 82
KEPT = 160


def show_photo(file: Path, longer_px: int) -> bytes:
    """Encode a photograph, upright, at most `longer_px` long, as JPEG; kept as long as the file does not change."""
    key = (0, 0)
    with suppress(OSError):  # `read_image` names the fault
        facts = file.stat()
        key = (facts.st_mtime_ns, facts.st_size)
    return _encode(file, key, longer_px)


@lru_cache(maxsize=KEPT)
def _encode(file: Path, key: tuple[int, int], longer_px: int) -> bytes:
    pixels = read_image(file, longer_px)
    share = longer_px / max(pixels.shape[:2])
    if share < 1:
        size = (max(1, round(pixels.shape[1] * share)), max(1, round(pixels.shape[0] * share)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return encode_image(pixels, "JPEG", quality=QUALITY)


PAGE_FILES = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/parts.js": ("parts.js", "text/javascript; charset=utf-8"),
    "/camera.js": ("camera.js", "text/javascript; charset=utf-8"),
}
UPLOAD_TYPE = "application/octet-stream"
"""Bytes without a name, which no form of another site can send."""
CLOSED, WRONG_TYPE, NO_SENSE, DEFECT, TROUBLE = 499, 415, 422, 500, 507
KEEP_PICTURE = {"cache-control": "private, max-age=3600"}


def make_app(session: Session, access: Access, predictor: Predictor, most_bytes: int = MOST_BYTES) -> Guard:
    """Make the application behind its guard; the caller starts and stops `predictor`, uploads have `most_bytes`."""
    # without FastAPI's pages, which load scripts from elsewhere
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    _answer_errors(app)
    _add_page(app)
    _add_pictures(app, session, GhostRenderer(session.workspace, session.plan))
    _add_shots(app, session, predictor)
    _add_upload(app, session, most_bytes)
    return Guard(app, access)


def _answer_errors(app: FastAPI) -> None:
    @app.exception_handler(ToolkitError)
    async def explain(_: Request, error: ToolkitError) -> Response:
        # a fault of the request, or else of the disk or the workspace
        return JSONResponse({"error": str(error)}, error.status if isinstance(error, Refused) else TROUBLE)

    @app.exception_handler(OSError)
    async def blame_disk(_: Request, error: OSError) -> Response:
        return JSONResponse({"error": str(explain_write_error(Path(error.filename or "?"), error))}, TROUBLE)

    @app.exception_handler(RequestValidationError)
    async def name_field(_: Request, error: RequestValidationError) -> Response:
        # the first wrong field is enough for a message on a phone
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"][1:])
        return JSONResponse({"error": f"{field}: {first['msg']}"}, NO_SENSE)

    @app.exception_handler(Exception)
    async def admit(_: Request, error: Exception) -> Response:
        return JSONResponse({"error": f"a defect of the studio: {type(error).__name__}; see its window"}, DEFECT)

    @app.exception_handler(HTTPException)
    async def refuse(_: Request, error: HTTPException) -> Response:
        return JSONResponse({"error": str(error.detail)}, error.status_code)


def _add_page(app: FastAPI) -> None:
    def serve(name: str, kind: str) -> Callable[[], Response]:
        content = (files("toolkit.rooms.photos.studio") / name).read_bytes()
        return lambda: Response(content, media_type=kind)

    for address, (name, kind) in PAGE_FILES.items():
        app.get(address)(serve(name, kind))


def _add_pictures(app: FastAPI, session: Session, artist: GhostRenderer) -> None:
    @app.get("/api/shots/{number}/ghost.png")
    def ghost(number: int) -> Response:
        step = session.find_step(number)
        content = artist.draw(step.object, step.variant, step.pose_id)
        return Response(content, media_type="image/png", headers=KEEP_PICTURE)

    @app.get("/api/shots/{number}/photo.jpg")
    def photo(number: int, large: bool = False) -> Response:
        shot = session.look_up(number)
        if shot.path is None:
            raise Refused(NOT_FOUND, f"shot {number} has no photograph yet")
        return _jpeg(show_photo(session.source_dir / shot.path, PREVIEW_PX if large else THUMB_PX))

    @app.get("/api/shots/{number}/waiting.jpg")
    def waiting(number: int) -> Response:
        file = session.folders.find_waiting(session.find_step(number))
        if file is None:
            raise Refused(NOT_FOUND, f"shot {number} has no photograph that waits for a decision")
        return _jpeg(show_photo(file, PREVIEW_PX))


def _add_shots(app: FastAPI, session: Session, predictor: Predictor) -> None:
    # every answer has the whole session, so the page is never behind
    def tell(number: int) -> dict[str, Any]:
        predictor.wake()
        return {**describe_session(session, predictor), "shot": describe_place(session, session.look_up(number))}

    @app.get("/api/state")
    def state() -> dict[str, Any]:
        return describe_session(session, predictor)

    @app.get("/api/shots/{number}")
    def shot(number: int) -> dict[str, Any]:
        found = session.look_up(number)
        # in the background: it is ready when the photograph has been taken
        Thread(target=session.inspector.warm_up, args=(found.step,), daemon=True).start()
        return describe_place(session, found)

    @app.get("/api/shots/{number}/verdict")
    def verdict(number: int) -> dict[str, Any]:
        found = session.inspect_waiting(number)
        if found is None:
            raise Refused(NOT_FOUND, f"shot {number} has no photograph that waits for a decision")
        return describe_inspection(found)

    @app.post("/api/shots/{number}/keep")
    def keep(number: int, sha256: str) -> dict[str, Any]:
        session.keep(number, sha256)
        return tell(number)

    @app.post("/api/shots/{number}/discard")
    def discard(number: int) -> dict[str, Any]:
        session.discard(number)
        return tell(number)

    @app.post("/api/shots/{number}/skip")
    def skip(number: int, skipped: bool = True) -> dict[str, Any]:
        session.skip(number, skipped)
        return tell(number)

    @app.post("/api/shots/{number}/undo")
    def undo(number: int) -> dict[str, Any]:
        undo_keep(session, number)
        return tell(number)


def _add_upload(app: FastAPI, session: Session, most_bytes: int) -> None:
    @app.post("/api/shots/{number}/photo")
    async def upload(number: int, request: Request) -> Any:
        session.find_step(number)
        if request.headers.get("content-type", "").split(";")[0].strip().lower() != UPLOAD_TYPE:
            raise Refused(WRONG_TYPE, f"expected the photograph's bytes as {UPLOAD_TYPE}")
        length = request.headers.get("content-length", "")
        # digits alone: int() accepts signs and underscores, and refuses thousands of digits
        announced = int(length[:20]) if length.isascii() and length.isdecimal() else None
        try:
            file = await receive_file(request.stream(), session.folders, announced, most_bytes)
        except ClientDisconnect:
            return Response(status_code=CLOSED)  # nobody hears it; the upload is deleted
        # in a thread, so that the page is served meanwhile
        found = await run_in_threadpool(session.receive, number, file)
        if found is None:
            return {"there": True}
        return {"there": False, **describe_inspection(found)}


def _jpeg(content: bytes) -> Response:
    return Response(content, media_type="image/jpeg")
