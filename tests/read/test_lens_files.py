"""Lens files as many programs write them: the right pinhole, or a refusal by the model's name."""

import json
from collections.abc import Mapping

import cv2
import numpy as np
import pytest

from gmrdata.read.intrinsics import read_intrinsics
from gmrdata.values.errors import BadIntrinsics
from gmrdata.write.pickles import python2_pickle

SIZE_PX = (640, 480)
K = [[600.0, 0, 319.5], [0, 605, 239.5], [0, 0, 1]]
K_ROW = "[600, 0, 319.5, 0, 605, 239.5, 0, 0, 1]"
FLAT = {"fl_x": 600, "fl_y": 605, "cx": 320, "cy": 240, "w": 640, "h": 480, "k1": -0.1}
INSIDE = '<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'


def framed(*frames: Mapping[str, object], **shared: object) -> str:
    return json.dumps(
        shared | {"frames": [{"file_path": f"{n}.png", **one} for n, one in enumerate(frames)]}
    )


READ = {
    "ros.yaml": f"""image_width: 640
image_height: 480
camera_matrix: {{rows: 3, cols: 3, data: {K_ROW}}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [-0.1, 0, 0, 0, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [590, 0, 318, 0, 0, 600, 238, 0, 0, 0, 1, 0]}}
""",
    "ros_rational.yaml": f"""image_width: 640
image_height: 480
camera_matrix: {{rows: 3, cols: 3, data: {K_ROW}}}
distortion_model: rational_polynomial
distortion_coefficients: {{rows: 1, cols: 8, data: [-0.1, 0, 0, 0, 0, 0, 0, 0]}}
""",
    "ros2_echo.yaml": f"""header:
  stamp: {{sec: 1, nanosec: 2}}
  frame_id: cam
height: 480
width: 640
distortion_model: plumb_bob
d: [-0.1, 0.0, 0.0, 0.0, 0.0]
k: {K_ROW}
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [590, 0, 318, 0, 0, 600, 238, 0, 0, 0, 1, 0]
binning_x: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}}
""",
    "kalibr.yaml": """cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [600, 605, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
""",
    "euroc.yaml": """# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
rate_hz: 20
resolution: [640, 480]
camera_model: pinhole
intrinsics: [600, 605, 319.5, 239.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.1, 0, 0, 0]
""",
    "orb_slam.yaml": """%YAML:1.0

#--------------------
Camera.type: "PinHole"
Camera.fx: 600.0
Camera.fy: 605.0
Camera.cx: 319.5
Camera.cy: 239.5
Camera.k1: -0.1
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: 640
Camera.height: 480
Camera.fps: 30.0
ORBextractor.nFeatures: 1000
""",
    "orb_slam3.yaml": """%YAML:1.0
Camera.type: "PinHole"
Camera1.fx: 600.0
Camera1.fy: 605.0
Camera1.cx: 319.5
Camera1.cy: 239.5
Camera1.k1: -0.1
Camera.width: 640
Camera.height: 480
""",
    "vins.yaml": """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 640
image_height: 480
distortion_parameters:
   k1: -0.1
   k2: 0.0
   p1: 0.0
   p2: 0.0
projection_parameters:
   fx: 600.0
   fy: 605.0
   cx: 319.5
   cy: 239.5
""",
    "opencv.xml": f"""<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<image_height>480</image_height>
{INSIDE}<data>600. 0. 319.5 0. 605. 239.5 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt><data>
-0.1 0. 0. 0. 0.</data></distortion_coefficients>
</opencv_storage>
""",
    "openpose.xml": f"""<?xml version="1.0"?>
<opencv_storage>
<CameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>4</cols><dt>d</dt><data>
    0. -1. 0. 0.5 1. 0. 0. -0.2 0. 0. 1. 2.3</data></CameraMatrix>
<Intrinsics type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>
    {K_ROW.strip("[]").replace(",", "")}</data></Intrinsics>
<Distortion type_id="opencv-matrix"><rows>8</rows><cols>1</cols><dt>d</dt><data>
    -0.1 0. 0. 0. 0. 0. 0. 0.</data></Distortion>
</opencv_storage>
""",
    "easymocap.yml": f"""%YAML:1.0
---
names:
   - "01"
K_01: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {K_ROW}
dist_01: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [-0.1, 0., 0., 0., 0.]
""",
    "pose2sim.toml": """[cam_01]
name = "cam_01"
size = [ 640.0, 480.0]
matrix = [ [ 600.0, 0.0, 319.5], [ 0.0, 605.0, 239.5], [ 0.0, 0.0, 1.0]]
distortions = [ -0.1, 0.0, 0.0, 0.0]
rotation = [ 1.2, 0.1, -0.2]
translation = [ 0.1, 1.2, 5.3]
fisheye = false

[metadata]
adjusted = false
error = 0.0
""",
    "prox.json": json.dumps({"camera_mtx": K, "k": [-0.1, 0, 0, 0, 0], "c": [9, 9], "f": [9, 9]}),
    "mmpose.json": json.dumps(
        {"f": [600, 605], "c": [320, 240], "k": [-0.1, 0, 0], "p": [0, 0], "w": 640, "h": 480}
    ),
    "with_projection.json": json.dumps(
        {"camera_mtx": K, "k": [-0.1, 0, 0, 0, 0], "P": np.eye(3, 4).tolist()}
    ),
    "no_names.json": json.dumps(FLAT | {"names": []}),
    "metashape.xml": """<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>640</width>
  <height>480</height>
  <f>605</f>
  <cx>0</cx>
  <cy>0</cy>
  <b1>-5</b1>
  <k1>-0.1</k1>
  <date>2024-01-01T00:00:00Z</date>
</calibration>
""",
    "python.json": json.dumps({"camera_matrix": K, "dist_coeff": [[-0.1, 0, 0, 0, 0]]}),
    "calibrate.json": json.dumps({"ret": 0.3, "mtx": K, "dist": [[-0.1], [0], [0], [0], [0]]}),
    "printed.txt": "{'mtx': array([[600., 0., 319.5],\n [0., 605., 239.5], [0., 0., 1.]]), "
    "'dist': array([[-0.1, 0., 0., 0., 0.]], dtype=float32)}",
    "transforms.json": json.dumps({"camera_model": "OPENCV", **FLAT, "frames": [{}, {}]}),
    "per_frame.json": framed(FLAT, FLAT, camera_model="OPENCV"),
    "focuses.json": framed(FLAT, FLAT | {"fl_x": 601, "cy": 241}, FLAT | {"fl_x": 599, "cy": 239}),
    "realsense.json": json.dumps(
        {"width": 640, "height": 480, "ppx": 320, "ppy": 240, "fx": 600, "fy": 605,
         "model": "distortion.brown_conrady", "coeffs": [-0.1, 0, 0, 0, 0]}
    ),
    "basalt.json": json.dumps(
        {"value0": {"intrinsics": [{"camera_type": "pinhole-radtan8", "intrinsics":
         {"fx": 600, "fy": 605, "cx": 320, "cy": 240, "k1": -0.1, "k4": 0}}],
         "resolution": [[640, 480]]}}
    ),
    "opensfm.json": json.dumps(
        {"v2 phone 640 480 brown 0.9": {"projection_type": "brown", "width": 640, "height": 480,
         "focal_x": 600 / 640, "focal_y": 605 / 640, "c_x": 0, "c_y": 0, "k1": -0.1, "k2": 0}}
    ),
    "matlab.json": json.dumps(
        {"ImageSize": [480, 640], "RadialDistortion": [-0.1, 0], "TangentialDistortion": [0, 0],
         "FocalLength": [600, 605], "PrincipalPoint": [320.5, 240.5], "Skew": 0}
    ),
    **{f"{group}.json": json.dumps({"w": 640, "h": 480, "fx": 600, "fy": 605, "cx": 320, "cy": 240,
       group: {"k1": -0.1, "k2": 0}}) for group in ("distortion_coeffs", "lens_distortion", "D")},
    "droid.txt": "600 605 320 240 -0.1 0 0 0",
    "spectacular.json": json.dumps({"cameras": [
        {"focalLengthX": 600, "focalLengthY": 605, "model": "pinhole", "principalPointX": 320,
         "principalPointY": 240, "distortionCoefficients": [-0.1, 0.0, 0.02]}]}),
    "mast3r_slam.yaml": "width: 640\nheight: 480\n# fx, fy, cx, cy, k1, k2, p1, p2, k3\n"
    "calibration: [600, 605, 319.5, 239.5, -0.1, 0, 0, 0, 0]\n",
    "nerfstudio.json": json.dumps(
        {"w": 640, "h": 480, "fl_x": 600, "fl_y": 605, "cx": 320, "cy": 240, "frames": [],
         "camera_model": "OPENCV", "distortion_params": [-0.1, 0, 0, 0, 1e-4, 0]}
    ),
    "maplab.yaml": """label: rig
cameras:
- camera:
    distortion:
      parameters: {cols: 1, rows: 4, data: [-0.1, 0, 0, 0]}
      type: radial-tangential
    image_height: 480
    image_width: 640
    intrinsics: {cols: 1, rows: 4, data: [600, 605, 319.5, 239.5]}
    label: cam0
    line-delay-nanoseconds: 0
    type: pinhole
  T_B_C: {cols: 4, rows: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
""",
    "full_opencv.txt": "1 FULL_OPENCV 640 480 600 605 320 240 -0.1 0 0 0 0 0 0 0",
    "equals.cfg": "fx = 600\nfy = 605\ncx = 319.5\ncy = 239.5\nk1 = -0.1\nwidth = 640\n"
    "height = 480\n",
    "nerfies.json": json.dumps({
        "position": [0, 0, 0], "focal_length": 600, "pixel_aspect_ratio": 605 / 600, "skew": 0.0,
        "principal_point": [320, 240], "radial_distortion": [-0.1, 0, 0],
        "tangential_distortion": [0, 0], "image_size": [640, 480],
    }),
}  # fmt: skip
PINHOLES = {
    "wide.txt": "600 0 320 0 0 605 240 0 0 0 1 0\n",
    "printed_matrix.txt": "[[600. 0. 320.]\n [0. 605. 240.]\n [0. 0. 1.]]",
    "matlab_matrix.txt": "K = [600 0 320; 0 605 240; 0 0 1]",
    "matlab_lines.txt": "K = [600 0 320;\n 0 605 240;\n 0 0 1];\n",
    "scannet.txt": "600 0 320 0\n0 605 240 0\n0 0 1 0\n0 0 0 1\n",
    "open3d.json": json.dumps(
        {"width": 640, "height": 480, "intrinsic_matrix": [600, 0, 0, 0, 605, 0, 320, 240, 1]}
    ),
    "record3d": json.dumps(
        {"K": [600, 0, 0, 0, 605, 0, 320, 240, 1], "w": 640, "h": 480, "fps": 30}
    ),
    "four.txt": "600, 605, 320, 240",
    "41048190_3426.250.pincam": "1280 960 1200 1210 640 480\n",
    "four_in_k.json": json.dumps({"K": [600, 605, 320, 240], "focal_length": 600}),
    "k.txt": "600 0 320\n0 605 240\n0 0 1\n",
    "ros_block.yaml": "image_width: 640\nimage_height: 480\n"
    f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {K_ROW}\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n",
    "of_twice_the_size.json": json.dumps(
        {"fl_x": 1200, "fl_y": 1210, "cx": 640, "cy": 480, "w": 1280, "h": 960, "k1": 0.0}
    ),
    "zed.conf": "[LEFT_CAM_VGA]\nfx=600\nfy=605\ncx=319.5\ncy=239.5\nk1=0\n",
    "by_picture.txt": "600 605 320 240\n" * 9,
    "matrices.txt": "600 0 320 0 605 240 0 0 1\n" * 7,
    "matrices.json": json.dumps([[[600, 0, 320], [0, 605, 240], [0, 0, 1]]] * 2),
}
REFUSED = {
    "gyroflow.json": (
        json.dumps({"camera_brand": "GoPro", "calib_dimension": {"w": 640, "h": 480},
                    "fisheye_params": {"camera_matrix": K, "distortion_coeffs": [0.26, 0, 0, 0]}}),
        "fisheye (fisheye_params)",
    ),
    "openmvg.json": (
        json.dumps({"intrinsics": [{"key": 0, "value": {
            "polymorphic_name": "fisheye", "ptr_wrapper": {"id": 1, "data": {
                "width": 640, "height": 480, "focal_length": 600.0, "principal_point": [320, 240],
                "fisheye": [0.1, 0, 0, 0]}}}}]}),
        "camera model fisheye",
    ),
    "comma_f.yaml": ("f: 600,5\nc: [320, 240]\n", "write decimal points"),
    "comma_k1.yaml": ("fx: 600\nfy: 605\ncx: 320\ncy: 240\nk1: -0,1\n", "write decimal points"),
    "shares.txt": ("0.9375 1.26 0.5 0.5\n", "give it in pixels"),
    "list.json": (json.dumps([{"id": 0, "fx": 600, "fy": 605}]), "no principal point"),
    "ros_fisheye.yaml": (READ["ros.yaml"].replace("plumb_bob", "equidistant"), "equidistant"),
    "ros_noetic.yaml": (
        READ["ros.yaml"].replace("distortion_model: plumb_bob", "camera_model: fisheye"),
        "camera model fisheye",
    ),
    "ros_prism.yaml": (
        READ["ros_rational.yaml"].replace("0, 0, 0, 0, 0, 0, 0]", "0, 0, 0, 0, 0.2, 0, 0]"),
        "k4 of a rational",
    ),
    "kalibr_equi.yaml": (READ["kalibr.yaml"].replace("radtan", "equidistant"), "equidistant"),
    "kalibr_omni.yaml": (
        READ["kalibr.yaml"].replace("camera_model: pinhole", "camera_model: omni")
        .replace("[600,", "[1.7, 600,"), "camera model omni",
    ),
    "kalibr_fov.yaml": (READ["kalibr.yaml"].replace("radtan", "fov"), "camera model fov"),
    "kalibr_stereo.yaml": (
        READ["kalibr.yaml"] + READ["kalibr.yaml"].replace("cam0", "cam1").replace("600", "640"),
        "2 cameras that differ",
    ),
    "orb_fisheye.yaml": (
        READ["orb_slam.yaml"].replace("PinHole", "KannalaBrandt8"), "camera model KannalaBrandt8"
    ),
    "vins_mei.yaml": (
        READ["vins.yaml"].replace("PINHOLE", "MEI") + "mirror_parameters:\n   xi: 1.36\n",
        "camera model MEI",
    ),
    "vins_gamma.yaml": (
        READ["vins.yaml"].replace("PINHOLE", "MEI").replace("fx", "gamma1"), "camera model MEI"
    ),
    "generic.yaml": ("type : CentralGenericModel\nwidth : 640\ngrid : [0.1]\n", "CentralGeneric"),
    "mirror.yaml": (READ["vins.yaml"] + "mirror_parameters:\n   xi: 1.36\n", "with xi of 1.36"),
    "vins_kb.yaml": (READ["vins.yaml"].replace("PINHOLE", "KANNALA_BRANDT"), "KANNALA_BRANDT"),
    "opencv_fisheye.yaml": (
        "%YAML:1.0\n---\nfisheye_model: 1\n" + READ["ros.yaml"], "fisheye (fisheyemodel)"
    ),
    "opencv_fisheye.xml": (
        READ["opencv.xml"].replace("<image_h", "<fisheye_model>1</fisheye_model><image_h"),
        "fisheye (fisheyemodel)",
    ),
    "metashape_fisheye.xml": (READ["metashape.xml"].replace(">frame<", ">fisheye<"), "fisheye"),
    "metashape_skew.xml": (READ["metashape.xml"].replace("b1>", "b2>"), "with b2 of -5"),
    "metashape_k4.xml": (
        READ["metashape.xml"].replace("<k1>", "<k4>0.1</k4><k1>"), "k4 of a rational"
    ),
    "reality.xmp": (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/" xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">'
        '<Description xcr:DistortionModel="brown3" xcr:FocalLength35mm="26.1"/></x:xmpmeta>',
        "RealityCapture's",
    ),
    "nerf_fisheye.json": (json.dumps(FLAT | {"camera_model": "OPENCV_FISHEYE"}), "OPENCV_FISHEYE"),
    "nerf_frame.json": (framed(FLAT, FLAT | {"camera_model": "FISHEYE624"}), "FISHEYE624"),
    "nerf_360.json": (json.dumps(FLAT | {"camera_model": "EQUIRECTANGULAR"}), "EQUIRECTANGULAR"),
    "ngp.json": (json.dumps(FLAT | {"is_fisheye": True}), "fisheye (isfisheye)"),
    "two_lenses.json": (framed(FLAT, FLAT | {"fl_x": 700}), "2 cameras that differ"),
    "two_words.json": (framed(FLAT, {**FLAT, "fl_x": 700}, **FLAT), "2 cameras that differ"),
    "all_others.json": (framed(*[{"fl_x": 700}] * 2, **FLAT), "2 cameras that differ"),
    "one_bent.json": (framed(FLAT, {**FLAT, "k1": 0}), "2 cameras that differ"),
    "k4.json": (json.dumps(FLAT | {"k4": 0.01}), "k4 of a rational"),
    "prism.json": (json.dumps(FLAT | {"p3": 0.01}), "with p3 of 0.01"),
    "unknown_term.json": (json.dumps(FLAT | {"k9": 0.3}), "k9 that is not known"),
    "unknown_list.json": (
        json.dumps({"K": K, "distortion_opencv_fish": [1, 2]}), "distortionopencvfish"
    ),
    "egobody.json": (json.dumps({"camera_mtx": K, "k": [0.1, 0, 0, 0, 0, 1]}), "k4 of a rational"),
    "easymocap_two.yml": (
        READ["easymocap.yml"].replace('"01"', '"01"\n   - "02"')
        + f"K_02: {K_ROW.replace('600', '500')}\n", "2 cameras that differ"
    ),
    "model_of_group.json": (
        json.dumps(FLAT | {"distortion_model": {"type": "equidistant", "k1": -0.1}}), "equidistant"
    ),
    "maplab_fisheye.yaml": (
        READ["maplab.yaml"].replace("radial-tangential", "equidistant"), "equidistant"
    ),
    "list_of_group.json": (
        json.dumps(FLAT | {"distortion": {"values": [-0.1, 0, 0, 0]}}), "values that is not known"
    ),
    "nerfstudio_p1.json": (
        READ["nerfstudio.json"].replace("0.0001, 0]", "0.01, 0]"), "beyond k1 and k2 move"
    ),
    "model_beside.json": (json.dumps(FLAT | {"lens": {"model": "OPENCV_FISHEYE"}}), "FISHEYE"),
    "prefix.json": (json.dumps(FLAT | {"cam_k1": -0.3}), "camk1 that is not known"),
    "prefix_list.json": (
        json.dumps({"K": K, "opencv_distortion": [-0.3, 0, 0, 0]}), "opencvdistortion that is not"
    ),
    "realsense_back.json": (
        READ["realsense.json"].replace("brown_conrady", "inverse_brown_conrady"), "inverse_brown"
    ),
    "realsense_kb.json": (
        READ["realsense.json"].replace("brown_conrady", "kannala_brandt4"), "kannala_brandt4"
    ),
    "basalt_ds.json": (READ["basalt.json"].replace("pinhole-radtan8", "ds"), "camera model ds"),
    "opensfm_fisheye.json": (READ["opensfm.json"].replace('"brown"', '"fisheye"'), "fisheye"),
    "meshroom.sfm": (
        json.dumps({"intrinsics": [{"type": "radial3", "width": "640", "height": "480",
                    "focalLength": "3.4", "sensorWidth": "3.6"}]}), "Meshroom's",
    ),
    "dso.txt": ("Pinhole 0.5 0.8 0.5 0.5 0\n640 480\ncrop\n640 480\n", "DSO's"),
    "left.ini": ("[image]\n\nwidth\n640\n", "ROS's .ini"),
    "numpy.yaml": ("K: !!python/object/apply:numpy.core.multiarray._reconstruct\n", ".tolist()"),
    "stereo.yml": (
        f"%YAML:1.0\n---\nM1: {K_ROW}\nD1: [0]\nM2: {K_ROW.replace('600', '610')}\nD2: [0]\n",
        "2 cameras: M1 and M2",
    ),
    "division.txt": ("1 SIMPLE_DIVISION 640 480 600 320 240 0.1", "SIMPLE_DIVISION"),
    "prism.txt": ("1 THIN_PRISM_FISHEYE 640 480 600 600 320 240 0 0 0 0 0 0 0 0", "THIN_PRISM"),
    "rational.txt": ("1 FULL_OPENCV 640 480 600 605 320 240 0 0 0 0 0 0.2 0 0", "k4 of a rational"),
    "billion.xml": ("<!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>", "DOCTYPE"),
    "six.txt": ("640 480 320 240 0.1 0.05", "array of size 6"),  # terms, or a size: nobody knows
    "moves.txt": ("600 0 320 5\n0 605 240 0\n0 0 1 0\n", "a projection that also moves"),
    "no_centre.json": (json.dumps({"fx": 600, "fy": 605}), "no principal point"),
    "other.json": (json.dumps({"exposure": 3, "iso": 100}), "but exposure, iso"),
}  # fmt: skip


@pytest.mark.parametrize("name", READ | PINHOLES)
def test_a_pinhole_is_read_whoever_wrote_it(tmp_path, name):
    (tmp_path / name).write_text((READ | PINHOLES)[name])
    lens = read_intrinsics(tmp_path / name, SIZE_PX)
    assert lens.focal_px == pytest.approx((600, 605), rel=1e-12)
    assert lens.centre_px == pytest.approx((320, 240), rel=1e-12)
    assert lens.radial == (-0.1 if name in READ else 0.0, 0.0) and lens.size_px == SIZE_PX


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_such_pinhole_is_refused_by_its_name(tmp_path, name):
    content, said = REFUSED[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(BadIntrinsics) as error:
        read_intrinsics(tmp_path / name, SIZE_PX)
    assert said in str(error.value) and str(tmp_path / name) in str(error.value)


@pytest.mark.parametrize("centre", ["<cx>12.5</cx><cy>9.25</cy>", "<cx>-12.5</cx>", ""])
def test_metashapes_cameras_count_their_centre_from_the_middle(tmp_path, centre):
    """As it exports the cameras of a chunk: there `type` says what `projection` says of a lens."""
    size = '<resolution width="640" height="480"/>'
    sensor = f"""<sensor id="0" label="FC550 (15mm)" type="frame">{size}
<property name="focal_length" value="15"/><property name="layer_index" value="0"/>
<calibration type="frame" class="adjusted">{size}<f>605</f>{centre}<b1>-5</b1><k1>-0.1</k1>
</calibration>
<covariance><params>f k1</params><coeffs>1.3e+02 -3.6e-01 -3.6e-01 8.8e-01</coeffs></covariance>
</sensor>"""
    (tmp_path / "cameras.xml").write_text(
        f'<document version="2.0.0"><chunk label="Chunk 1"><sensors next_id="1">{sensor}</sensors>'
        '<cameras next_id="1"><camera id="0" sensor_id="0" label="1"/></cameras></chunk></document>'
    )
    initial = f'<calibration type="frame" class="initial">{size}<f>700</f></calibration>'
    (tmp_path / "both.xml").write_text(
        (tmp_path / "cameras.xml").read_text().replace("<calibration", f"{initial}<calibration")
    )
    lens = read_intrinsics(tmp_path / "cameras.xml", SIZE_PX)
    assert read_intrinsics(tmp_path / "both.xml", SIZE_PX) == lens
    off_px = {"": (0, 0), "<cx>-12.5</cx>": (-12.5, 0)}.get(centre, (12.5, 9.25))
    assert lens.centre_px == (320 + off_px[0], 240 + off_px[1])
    assert lens.focal_px == (600, 605) and lens.radial == (-0.1, 0)


def test_what_python_saves_is_read_too(tmp_path):
    matrix, terms = np.array(K), np.array([[-0.1, 0, 0, 0, 0]])
    np.savez(tmp_path / "calibration.npz", mtx=matrix, dist=terms, rvecs=np.zeros((9, 3, 1)))
    (tmp_path / "wide.p").write_bytes(python2_pickle({"mtx": matrix, "dist": terms}))
    of_opencap = {
        "intrinsicMat": matrix,
        "distortion": terms,
        "imageSize": np.array([[480], [640]]),
    }
    (tmp_path / "opencap.pickle").write_bytes(python2_pickle(of_opencap))
    for name in ("calibration.npz", "wide.p", "opencap.pickle"):
        lens = read_intrinsics(tmp_path / name, SIZE_PX)
        assert (lens.focal_px, lens.centre_px, lens.radial) == ((600, 605), (320, 240), (-0.1, 0))
    by_picture = {"matrices": np.tile(matrix, (5, 1, 1)), "fours": [[600, 605, 319.5, 239.5]] * 5}
    of_dict = {"mtx": matrix, "dist": terms}
    for name, value in ({"k": matrix, "dict": of_dict} | by_picture).items():
        np.save(tmp_path / f"{name}.npy", value)  # type: ignore[arg-type]
        assert read_intrinsics(tmp_path / f"{name}.npy", SIZE_PX).focal_px == (600, 605)
    plain = (tmp_path / "k.npy").read_bytes()
    for wrong in (b"(3, 3, }", b"(9999999999999,), }"):  # a header that doesn't end, and 71 TiB
        header = plain.replace(b"(3, 3), }".ljust(20), wrong.ljust(20))
        (tmp_path / "k.npy").write_bytes(header)
        with pytest.raises(BadIntrinsics, match=r"k\.npy: can't be read as intrinsics"):
            read_intrinsics(tmp_path / "k.npy", SIZE_PX)
    (tmp_path / "session.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(BadIntrinsics, match="MATLAB"):
        read_intrinsics(tmp_path / "session.mat", SIZE_PX)


@pytest.mark.parametrize(
    ("suffix", "size_px"), [("yaml", ()), ("yaml", SIZE_PX), ("xml", ()), ("json", ())]
)
def test_each_of_opencvs_formats(tmp_path, suffix, size_px):
    path = tmp_path / f"camera.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, size in zip(("image_width", "image_height"), size_px, strict=False):
        storage.write(name, size)
    storage.write("camera_matrix", np.array(K))
    storage.write("distortion_coefficients", np.array([[-0.1, 0.0, 0, 0, 0]]))
    storage.release()
    lens = read_intrinsics(path, SIZE_PX)
    assert (lens.focal_px, lens.centre_px, lens.radial) == ((600, 605), (320, 240), (-0.1, 0))


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("fisheye_calibration_as_pinhole/ros_equidistant0.yaml", "camera model equidistant"),
        ("fisheye_calibration_as_pinhole/transforms_fisheye0.json", "camera model OPENCV_FISHEYE"),
        ("intrinsics_unclear/transforms_perframe.json", "2 cameras that differ"),
        ("intrinsics_unclear/full_opencv.txt", None),
        ("intrinsics_unclear/ros_echo.yaml", None),
        ("intrinsics_unclear/cv_python.json", None),
    ],
)
def test_files_that_reports_led_to(shared_path, place, said):
    path = shared_path(f"odd/{place}")
    if said is None:
        lens = read_intrinsics(path, (360, 480))
        assert lens.focal_px == (338, 338) and lens.radial == (-0.027, 0)
        assert lens.centre_px == pytest.approx((180, 240), abs=0.5)
        return
    with pytest.raises(BadIntrinsics, match=said):
        read_intrinsics(path, (360, 480))
