"""What of a character's file comes along with its skeleton."""

from tests.blender.jobs import ask_blender


def test_what_hangs_on_a_bone_by_way_of_others_comes_along(tmp_path):
    """Glasses on a plain node, and a badge on a hat, were left out without a word."""
    found = ask_blender("accessories_by_blender.py", tmp_path / "someone.glb")
    head = dict.fromkeys(("Badge", "Glasses", "Hat"), "Head")
    assert found == {"taken": {"Body": "", **head}, "left": ["Floor", "Shoe"]}
