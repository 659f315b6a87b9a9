"""The odd files, how each is run, and what is right, by their READMEs."""

import numpy as np
from odd.run import Case, Run, is_same_motion

_MOTIONS = "motions . --out OUT"
_VIDEO = "video FILE --out OUT --fps-hz 10 --poses none --masks none --no-page"
_LENS = "video clip.mp4 --out OUT --poses none --masks none --no-page --intrinsics FILE"
_PEOPLE = (
    "video FILE --out OUT --no-page --detector MODELS/yolox_nano.onnx"
    " --landmark-network MODELS/pose_landmark_lite.tflite"
)
_INFER = "infer FILE --fps-hz 30 --out OUT --no-video"


def _turned(folder: str, plain: str, other: str) -> Case:
    return Case(folder, other, _MOTIONS, lambda run: is_same_motion(run, plain, other), "--up")


def _lens(folder: str, file: str, k1: float | None, asks_for: str) -> Case:
    """A lens of 338 px is right to be taken, if its k1 is; None if nothing of it is."""

    def is_right(run: Run) -> bool:
        lens = run.json("intrinsics/intrinsics.json")
        found = lens["radial_k1"] or 0.0
        return k1 is not None and abs(lens["focal_px"] - 338) < 0.1 and abs(found - k1) < 1e-6

    # Where the lens must be held against the frames, the verdict counts; else it is only read.
    words = f"{_LENS} --strict" if folder == "given_k1_not_checked" else _LENS
    return Case(folder, file, words, is_right, asks_for)


def _rate(file: str, rate_hz: float, last_s: float) -> Case:
    def is_right(run: Run) -> bool:
        # A file for each run of frames that are kept.
        found_hz = {
            float(np.load(body)["mocap_framerate"])
            for body in run.out.glob("files/amass/person_0/*.npz")
        }
        times_s = np.loadtxt(run.out / "files" / "tum" / "person_0.txt")[:, 0]
        is_rate = bool(found_hz) and all(abs(one - rate_hz) < 0.005 for one in found_hz)
        return is_rate and abs(times_s[-1] - last_s) < 0.0015

    return Case("mkv_frame_rate", file, _PEOPLE, is_right)


def _has_mean_betas(run: Run) -> bool:
    right = [*np.linspace(1, -1, 10), *[0.0] * 6]
    return np.allclose(run.clip("m06_betas_per_frame")["betas"], right, atol=0.005)


def _has_ten_frames(run: Run) -> bool:
    return len(run.json("verdict.json")) > 0 and "of 10 frames" in run.said


def _walks(run: Run) -> bool:
    path_m = run.clip("a01_comma")["trans"]
    return len(path_m) == 60 and bool(np.ptp(path_m, axis=0).max() > 0.3)


def _infers(run: Run) -> bool:
    return (run.out / "infer.json").is_file()


CASES = (
    _turned("amass_y_up", "m00_plain_poses", "n01_yup_poses"),
    _turned("bvh_rest_y_up_motion_z_up", "plain", "b01_rest_yup_motion_zup"),
    _turned("bvh_rest_y_up_motion_z_up", "plain", "c06_reference_turned"),
    Case(
        "amass_betas_per_frame", "m06_betas_per_frame.npz", "motions FILE --body body --out OUT",
        _has_mean_betas, "betas.*frame",
    ),
    Case("decimal_comma", "a01_comma.bvh", _MOTIONS, _walks, "decimal comma|commas"),
    Case(
        "hdm05_skeleton_name", "HDM_bd_01-01_01_120.amc", "motions .",
        lambda run: "HDM_bd_01-01_01_120" in run.said and " 40 " in run.said and "120" in run.said,
    ),
    Case(
        "name_not_utf8", "motions", "motions DIR --out OUT",
        lambda run: len(list(run.out.glob("clips/*/clip.npz"))) == 1, "rename", made_by="make.sh",
    ),
    Case(
        "name_not_utf8", "infer", "infer MADE --out OUT --no-video", _infers, "rename",
        made_by="make.sh",
    ),
    _lens("fisheye_calibration_as_pinhole", "ros_equidistant0.yaml", None, "fisheye|equidistant"),
    _lens("fisheye_calibration_as_pinhole", "transforms_fisheye0.json", None, "fisheye"),
    _lens("given_k1_not_checked", "cameras.txt", None, r"k1[^.]*0\.3.*(ask|show)"),
    _lens("intrinsics_unclear", "full_opencv.txt", -0.027, "FULL_OPENCV.*known are"),
    _lens("intrinsics_unclear", "ros_echo.yaml", -0.027, ""),
    _lens("intrinsics_unclear", "cv_python.json", -0.027, r"cv_python\.json: \w+ \w+"),
    _lens("intrinsics_unclear", "transforms_perframe.json", None, "frame.*(other|differ|lens)"),
    _rate("obs60.mkv", 60.0, 1.483),
    _rate("base.mkv", 30.0, 2.967),
    Case("macos_dot_underscore", "frames", _VIDEO, _has_ten_frames),
    Case(
        "index_cut_off", "trunc_end.mp4", "video FILE --out OUT --masks none",
        lambda run: False, "before its index",
    ),
    Case(
        "results_saved_otherwise", "hmr4d_results.pt.pkl", _INFER, _infers, "give hmr4d_results.pt"
    ),
    Case("results_saved_otherwise", "hmr4d_old.pt", _INFER, lambda run: False, r"before.* 1\.6"),
    Case("results_saved_otherwise", "wham_ordereddict.pkl", _INFER, _infers),
)  # fmt: skip
