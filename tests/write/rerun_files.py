"""What rerun's own reader finds in a recording; rerun 0.23 and 0.41 have different readers."""

from pathlib import Path
from typing import Any

import numpy as np

OLD_NAMES = {
    "Points3D:positions": "Position3D",
    "Mesh3D:vertex_positions": "Position3D",
    "Mesh3D:triangle_indices": "TriangleIndices",
    "LineStrips3D:strips": "LineStrip3D",
    "Transform3D:translation": "Translation3D",
    "Transform3D:mat3x3": "TransformMat3x3",
    "Pinhole:image_from_camera": "PinholeProjection",
    "Pinhole:resolution": "Resolution",
    "EncodedImage:blob": "Blob",
    "SegmentationImage:buffer": "ImageBuffer",
    "Clear:is_recursive": "ClearIsRecursive",
}
"""What rerun 0.23 calls a component."""


Row = tuple[int | None, float | None, Any]
"""Frame, time [s] and value; neither of them for what holds always."""


class Recorded:
    """A recording's values by entity, component and time."""

    def __init__(self, path: Path) -> None:
        self._recording = None
        try:
            from rerun.dataframe import load_recording
        except ImportError:
            self._rows = _of_chunks(path)
        else:
            self._recording = load_recording(path)
            self._rows = _of_views(self._recording)

    def entities(self) -> set[str]:
        """All that has one of the components above."""
        return {entity for entity, _ in self._rows}

    def values(self, entity: str, component: str) -> dict[Any, Any]:
        """What was logged, by frame; by None what holds always."""
        return {frame: value for frame, _, value in self._rows.get((entity, component), [])}

    def times_s(self, entity: str, component: str) -> dict[Any, Any]:
        """Time of each frame in which something was logged."""
        return {frame: time_s for frame, time_s, _ in self._rows.get((entity, component), [])}

    def shown(self, entity: str, component: str, n_frames: int) -> set[int]:
        """Frames in which a viewer has a value: one logged then, or before and not cleared."""
        if self._recording is not None:
            view = self._recording.view(index="frame", contents=f"/{entity}").fill_latest_at()
            table = view.using_index_values(np.arange(n_frames)).select().read_all().to_pydict()
            values = zip(table["frame"], table[f"/{entity}:{OLD_NAMES[component]}"], strict=True)
            return {frame for frame, value in values if value}
        there, cleared = self.values(entity, component), self.values(entity, "Clear:is_recursive")
        frames, on = set(), False
        for frame in range(n_frames):
            on = frame in there or (on and frame not in cleared)
            frames |= {frame} if on else set()
        return frames

    def transforms(self, entity: str) -> dict[Any, np.ndarray]:
        """Transform3D (4, 4) by frame."""
        turns = self.values(entity, "Transform3D:mat3x3")
        moves = self.values(entity, "Transform3D:translation")
        assert turns.keys() == moves.keys()
        found = {}
        for frame, columns in turns.items():
            found[frame] = np.eye(4)
            found[frame][:3, :3] = np.reshape(columns[0], (3, 3)).T
            found[frame][:3, 3] = moves[frame][0]
        return found


def _of_views(recording: Any) -> dict[tuple[str, str], list[Row]]:
    """With the reader of rerun 0.23.  A value that a Clear took away is empty."""
    rows: dict[tuple[str, str], list[Row]] = {}
    columns = recording.schema().component_columns()
    for entity, static in sorted({(column.entity_path, column.is_static) for column in columns}):
        view = recording.view(index="frame", contents=entity)  # has the static ones in all rows
        table = (view.select_static() if static else view.select()).read_all().to_pydict()
        frames = [None] if static else table["frame"]
        times = [None] if static else [at.total_seconds() for at in table["time"]]
        for new, old in OLD_NAMES.items():
            if values := table.get(f"{entity}:{old}"):
                found = [row for row in zip(frames, times, values, strict=True) if row[2]]
                if found:
                    rows[entity.strip("/"), new] = found
    return rows


def _of_chunks(path: Path) -> dict[tuple[str, str], list[Row]]:
    """With the reader of rerun 0.41."""
    from rerun.chunk import RrdReader

    rows: dict[tuple[str, str], list[Row]] = {}
    for chunk in RrdReader(path).stream().collect().stream():
        table = chunk.to_record_batch().to_pydict()
        empty = [None] * chunk.num_rows
        frames = table.get("frame", empty)
        times = [at if at is None else at.total_seconds() for at in table.get("time", empty)]
        for part in OLD_NAMES.keys() & table.keys():
            key = (chunk.entity_path.strip("/"), part)
            found = zip(frames, times, table[part], strict=True)
            rows[key] = rows.get(key, []) + [row for row in found if row[2]]
    return rows
