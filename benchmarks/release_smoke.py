"""Every verb once, on a gait that a program makes: the smallest recipes, and the commands."""

_GMR = """
  model: {layers: 1, hidden: 8}
  loss: {n_vertices: 20}
  windows: {frames: 10}
  batch_size: 2
  steps: 3
"""
RECIPES = {
    "demo.yaml": f"""
recipe: demo
workers: 1
film: {{duration_s: 1.0, max_frames: 10, width_px: 160, height_px: 90}}
clips:
  - {{id: panning, gait: walk, programme: {{kind: panning}}}}
training: {{gait_count: 1, gait_duration_s: 2.0}}
render: {{samples: 1}}
gmr: {_GMR}""",
    "set.yaml": """
recipe: synthetic
name: tiny
workers: 1
film: {duration_s: 1.5, fps_hz: 10, width_px: 96, height_px: 64}
render: {samples: 1}
clips:
  - {id: walk, gait: walk, programme: {kind: circular}}
  - {id: run, gait: run, programme: {kind: panning}}
""",
    "gmr.yaml": f"""
recipe: gmr
train: {_GMR}""",
    "twin.yaml": """
recipe: threedpw_twin
set:
  recipe: synthetic
  name: tiny_twin
  workers: 1
  film: {duration_s: 0.8, fps_hz: 30, width_px: 180, height_px: 320, hfov_deg: 30.8}
  render: {samples: 1}
  clips:
    - {id: walk_00, gait: walk, programme: {kind: panning, distance_m: 5.0}}
twin:
  faults: {invalid_runs: [1, 1], invalid_frames: [2, 4]}
""",
}
_SEEN = "demo/regenerated/panning/sequence/clip.npz"
_FRAMES = "demo/render/panning/frames"
COMMANDS = (
    "blender setup",
    "doctor",
    "fetch models --dry-run",
    "demo --recipe demo.yaml --out demo",
    "report demo",
    f"masks {_FRAMES} --masks silhouette --camera-body {_SEEN} --out masks",
    f"sfm {_FRAMES} --camera-body {_SEEN} --out sequence",
    f"video {_FRAMES} --masks none --fov 60 --fps-hz 10 --out video",
    "page video",
    "render set.yaml --out set",
    "manifest check set/synthetic.yaml",
    "manifest show set/synthetic.yaml",
    "manifest diff set/synthetic.yaml set/synthetic.yaml",
    "motions set/render --out motions",
    "motions set/render --out shared/motions --shard 1/2",
    "merge shared/motions",
    "motions set/render --out shared/motions --shard 2/2",
    "manifest diff motions/motions.yaml shared/motions/motions.yaml",
    "train set/synthetic.yaml --recipe gmr.yaml --out gmr",
    "evaluate gmr set/synthetic.yaml --out scores",
    "baseline zero set/synthetic.yaml --out zero",
    "evaluate zero/predictions set/synthetic.yaml --out zero_scores",
    "compare scores/scores.json zero_scores/scores.json --out compared",
    "infer set/render/walk/clip.npz --network gmr --out world",
    "delta-errors set/synthetic.yaml --network gmr --out errors.json",
    "fuse set/render/walk/clip.npz --network gmr --errors errors.json --out fused",
    "export set --to tum glb colmap amass bvh mp4 --out exported",
    "export gmr --to onnx --out network",
    "tables 2 --manifest motions/motions.yaml --out table2 --dry-run",
    "threedpw twin twin.yaml --out twin",
    "threedpw list --threedpw twin/3DPW",
    "threedpw show walk_00 --threedpw twin/3DPW",
    "threedpw regenerate --threedpw twin/3DPW --out regenerated",
    "threedpw compare regenerated/pseudo_gt.yaml",
    "floor --twins twin --out floor --dry-run",
    "run set.yaml --out set --dry-run",
)
"""Arguments of `gmrdata`, in an order in which each finds what it needs."""
REFUSED = {
    "merge shared/motions": "shard 2/2",
    "delta-errors set/synthetic.yaml --network gmr --out errors.json": "held none of these clips",
    "fuse set/render/walk/clip.npz --network gmr --errors errors.json --out fused": "errors.json",
}
"""Commands that must end with 1, and say so: there are shards that nobody has done, and a network
that was trained on everybody, so that nobody can say how wrong it is."""
