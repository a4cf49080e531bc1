"""The widget: a volume that turns live in Jupyter.

`Viewer` relays a live session (`relief.v1`, docs/LIVE.md) between the browser and the renderer in this process: `viewer.js` sends
commands and shows frames, and this module numbers the commands and keeps the newest state. There is no server and no port.
"""

from __future__ import annotations

import json
import pathlib
import struct
import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Optional

from . import _native
from ._native import ReliefError

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError("relief.Viewer needs anywidget; install it with: pip install 'relief[jupyter]'") from error

if TYPE_CHECKING:
    from . import Frame, Volume

_FOLDER = pathlib.Path(__file__).parent
#: The commands of the client that the browser may send.
_RELAYED = ("intent", "ack")
#: The camera in the header of a frame: its first byte and its 11 numbers.
_CAMERA_AT, _CAMERA = 80, struct.Struct("<11f")
#: The sequence number in the header of a frame.
_SEQUENCE_AT, _SEQUENCE = 12, struct.Struct("<I")
#: The keys of `shading` that a preset replaces.
_REFLECTION = ("ambient", "diffuse", "specular", "shininess")
_WAIT_S = 0.5
#: How often a frame is sent again that no browser acknowledges: Jupyter may lose a message.
_MOST_REPEATS = 3
_OPENING_S = 30.0


def merged(target: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """A dictionary with a JSON merge patch (RFC 7396)."""
    found = dict(target)
    for key, value in patch.items():
        if value is None:
            found.pop(key, None)
        elif isinstance(value, Mapping):
            known = found.get(key)
            found[key] = merged(known if isinstance(known, Mapping) else {}, value)
        else:
            found[key] = value
    return found


class Viewer(anywidget.AnyWidget):
    """A live view of a volume in Jupyter.

    Drag to turn, drag with Shift or the right button to move, turn the wheel to zoom, click to set the cursor, double-click to
    reset. Commands wait while a cell runs.

    `preset` is the transfer function; `cursor_mm` is the patient position of the cursor (LPS mm) or None, `error` the newest
    refusal. All can be observed.
    """

    _esm = _FOLDER / "viewer.js"
    _css = _FOLDER / "viewer.css"

    preset = traitlets.Unicode(None, allow_none=True).tag(sync=True)
    cursor_mm = traitlets.Tuple(None, allow_none=True, read_only=True).tag(sync=True)
    error = traitlets.Unicode("", read_only=True).tag(sync=True)
    _presets = traitlets.List(traitlets.Unicode()).tag(sync=True)
    _size = traitlets.List(traitlets.Int()).tag(sync=True)

    def __init__(
        self,
        volume: Volume,
        *,
        preset: Optional[str] = None,
        size: tuple[int, int] = (640, 480),
        scene: Optional[Mapping[str, Any]] = None,
        adapter: str = "best",
    ) -> None:
        """`scene` changes the request's defaults (docs/RENDERING.md), except for camera and size."""
        super().__init__(preset=preset, _presets=list(_native.PRESETS), _size=list(size))
        self._volume = volume
        self._lock = threading.Lock()
        self._seq = 0
        self._frame: Optional[bytes] = None
        self._acknowledged: Optional[int] = None
        self._session = _native.LiveSession(volume._native, adapter)
        settings: dict[str, Any] = {"scene": dict(scene or {}), "display": {"layout": "color"}}
        if preset is not None:
            settings["preset"] = preset
        self._tell({
            "type": "hello", "client": "relief for Python", "accept": {"color": ["jpeg"], "depth": ["none"]},
            "size_px": list(size), "settings": settings,
        })
        #: The keys of the scene that are set, without the transfer function of a preset.
        self._scene: dict[str, Any] = merged({}, scene or {})
        if preset is not None:
            self._scene.pop("transfer", None)
        try:
            self._expect_welcome()
        except ReliefError:
            self.close()
            raise
        self.on_msg(self._heard)
        self.observe(self._choose_preset, "preset")
        self._relay = threading.Thread(target=self._receive, name="relief viewer", daemon=True)
        self._relay.start()

    @property
    def camera(self) -> Optional[dict[str, Any]]:
        """The camera of the newest frame, as `Volume.render` takes it; None before the first frame."""
        if self._frame is None:
            return None
        numbers = _CAMERA.unpack_from(self._frame, _CAMERA_AT)
        field_deg, height_mm = numbers[9:]
        lens = {"perspective": {"vertical_fov_deg": field_deg}} if field_deg else {"orthographic": {"height_mm": height_mm}}
        return {"eye_mm": list(numbers[:3]), "look_at_mm": list(numbers[3:6]), "up": list(numbers[6:9]), "projection": lens}

    def look(self, azimuth_deg: float = 0.0, elevation_deg: float = 0.0, zoom: float = 1.0) -> None:
        """Looks at the volume from an angle."""
        self._command({"type": "intent", "intent": "look", "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "zoom": zoom})

    def change(self, scene: Mapping[str, Any]) -> None:
        """Changes keys of the scene (docs/RENDERING.md), such as `{"shading": {"ambient": 0.3}}`; None removes a key."""
        self._command({"type": "settings", "scene": dict(scene)})
        self._scene = merged(self._scene, scene)
        if scene.get("transfer") is not None:
            self.preset = None

    def render(self, *, size: Optional[tuple[int, int]] = None, **options: Any) -> Frame:
        """The picture of this view as a `Frame`; the options are those of `Volume.render`, and replace the view's."""
        camera = self.camera
        if camera is None:
            raise ReliefError("the viewer has no frame yet; run this in a cell after the one that shows it")
        view = {"scene": self._scene, "preset": self.preset, "camera": camera, "size": size or tuple(self._size)}
        return self._volume.render(**{**view, **options})

    def close(self) -> None:
        """Ends the session and removes the widget."""
        session: Optional[_native.LiveSession] = getattr(self, "_session", None)
        if session is not None:
            session.close()
        super().close()

    def _expect_welcome(self) -> None:
        """Waits until the session is open, and learns the preset that fits the volume."""
        answer = self._session.receive(_OPENING_S)
        message: dict[str, Any] = json.loads(answer) if isinstance(answer, str) else {"type": "nothing"}
        if message["type"] == "error":
            raise ReliefError(message["problem"]["detail"])
        if message["type"] != "welcome":
            raise ReliefError(f"the live session did not open within {_OPENING_S:.0f} s")
        self.preset = message["state"]["preset"]

    def _tell(self, message: Mapping[str, Any]) -> None:
        self._session.send(json.dumps(message))

    def _command(self, message: Mapping[str, Any]) -> None:
        """Sends a command with its number and time, in the order of the numbers."""
        with self._lock:
            if message["type"] == "intent":
                self._seq += 1
                message = {**message, "seq": self._seq, "t_ns": time.monotonic_ns()}
            self._tell(message)

    def _choose_preset(self, change: Any) -> None:
        if change["new"] is not None:
            # A preset brings its own transfer function and reflection.
            self._scene.pop("transfer", None)
            shading = self._scene.get("shading", {})
            for key in _REFLECTION:
                shading.pop(key, None)
            self._command({"type": "settings", "preset": change["new"]})

    def _heard(self, _: Any, content: Any, __: Sequence[Any]) -> None:
        """Relays a command of the browser. A browser that begins to show the widget gets the newest frame."""
        kind = content.get("type") if isinstance(content, dict) else None
        if kind in _RELAYED:
            if kind == "ack":
                self._acknowledged = content.get("frame")
            self._command(content)
        elif kind == "preset":
            self.preset = content["name"]
        elif kind == "ready" and self._frame is not None:
            self.send({"type": "frame"}, [self._frame])

    def _receive(self) -> None:
        repeats = 0
        while True:
            try:
                message = self._session.receive(_WAIT_S)
            except ReliefError:
                return  # closed
            if isinstance(message, bytes):
                self._frame, repeats = message, 0
                self.send({"type": "frame"}, [message])
            elif message is not None:
                self._learn(json.loads(message))
            elif self._frame is not None and repeats < _MOST_REPEATS and not self._is_shown(self._frame):
                repeats += 1
                self.send({"type": "frame"}, [self._frame])

    def _is_shown(self, frame: bytes) -> bool:
        """Whether the newest acknowledgement is that of this frame."""
        return bool(_SEQUENCE.unpack_from(frame, _SEQUENCE_AT)[0] == self._acknowledged)

    def _learn(self, message: Mapping[str, Any]) -> None:
        state = message.get("state")
        if message["type"] == "error":
            self.set_trait("error", message["problem"]["detail"])
        elif message["type"] == "state" and isinstance(state, dict):
            cursor = state["cursor_mm"]
            self.set_trait("cursor_mm", None if cursor is None else tuple(cursor))
            self.set_trait("error", "")
