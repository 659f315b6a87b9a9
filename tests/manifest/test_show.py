"""The table of a manifest, and the difference of two."""

import shutil
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from gmrdata.manifest.show import diff_manifests, manifest_table
from gmrdata.stage.recipes import published_manifest


def printed(path: Path) -> list[str]:
    console = Console(width=200, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(manifest_table(path))
    return console.export_text().splitlines()


def test_table_of_a_data_set(finished_data_set):
    lines = printed(finished_data_set / "set.yaml")
    assert "set 1.0.0 (synthetic), 2 clips" in lines[0]
    row = next(line for line in lines if "walk" in line and "circular" in line)
    cells = [cell.strip() for cell in row.strip("│").split("│")]
    assert cells == ["walk", "gmrdata: walk", "circular", "10", "6", "5", "0.5", "CC0-1.0"]
    assert any("10 frames to use" in line for line in lines)


def test_table_of_a_list():
    lines = printed(published_manifest("paper_table8"))
    assert any("26942 frames to use" in line for line in lines)


def test_brackets_are_text_and_no_markup(edit):
    def change(data: dict) -> None:
        data["description"] = "see [/red]"
        data["clips"][1]["licence"] = "free [bold] [/x]"

    lines = printed(edit(change))
    assert any("free [bold] [/x]" in line for line in lines)
    assert any("see [/red]" in line for line in lines)


def test_same_manifests_do_not_differ(finished_data_set):
    path = finished_data_set / "set.yaml"
    assert diff_manifests(path, path) == []


def test_what_changed_in_a_list_is_named_by_its_place(data_set, edit):
    """Both halves of a line were the start of the list, which is the same."""

    def ranges(last: int) -> Callable[[dict], None]:
        kept = [{"start": n, "stop": n + 1} for n in (0, 2, *range(4, last))]
        dropped = [{"start": n, "stop": n + 1, "reason": "no camera found"} for n in (1, 3)]
        dropped.append({"start": last, "stop": 6, "reason": "no camera found"})
        return lambda data: data["clips"][1].update(kept=kept, dropped=dropped)

    old = edit(ranges(5)).rename(data_set / "old.yaml")
    shutil.copy(old, data_set / "set.yaml")
    assert diff_manifests(old, edit(ranges(4))) == [
        "clips[walk].kept[2]: removed",
        "clips[walk].dropped[2].start: 5 -> 4",
    ]


def test_long_texts_are_whole_where_they_differ(finished_data_set, edit):
    old = finished_data_set / "set.yaml"
    new = edit(lambda data: data.update(description=data["description"] + 90 * "." + "!"))
    said = "Clips of a test."
    assert diff_manifests(old, new) == [f"description: {said} -> {said}{90 * '.'}!"]


def test_difference(finished_data_set, edit):
    def change(data: dict) -> None:
        data["version"] = "1.1.0"
        data["clips"][1]["fps_hz"] = 12.0
        data["clips"][1]["quality"]["scale"] = 2.0
        del data["clips"][1]["quality"]["registered_share"]
        data["clips"][0]["id"] = "new"

    old, new = finished_data_set / "set.yaml", edit(change)
    assert diff_manifests(old, new) == [
        "version: 1.0.0 -> 1.1.0",
        "clips[bare]: removed",
        "clips[walk].fps_hz: 10.0 -> 12.0",
        "clips[walk].quality.registered_share: removed (0.8333333333333334)",
        "clips[walk].quality.scale: added (2.0)",
        "clips[new]: added",
    ]
