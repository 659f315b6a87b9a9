"""GMR as an ONNX model: local rotations in, the motion between frames out.

All that stands between a person's local pose and the network (the representation of rotations, the
signs of quaternions over time, the extra inputs) is part of the graph, so that a user needs neither
torch nor gmrdata.  What else must be known stands in the model's metadata.
"""

import io
import warnings
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from gmrdata import __version__
from gmrdata.gmr.model import Gmr, MeanGmr, network_input
from gmrdata.gmr.predict import TrainedGmr
from gmrdata.values.body import JOINT_NAMES, N_LOCAL
from gmrdata.values.errors import MissingExtra
from gmrdata.values.shapes import Float

if TYPE_CHECKING:
    import onnx

OPSET = 17
INPUT, OUTPUTS = "local_rotmats", ("delta_rotmats", "delta_m")
ABOUT = {
    INPUT: "(batch, frames, 23, 3, 3) float32: parent_from_joint rotations of the joints in"
    " `joints`, relative to SMPL's T-pose, two or more frames at `fps_hz`",
    OUTPUTS[0]: "(batch, frames - 1, 3, 3) float32: dR = R_i^T R_{i+1} of the root, in the root's"
    " frame; R_{i+1} = R_i dR",
    OUTPUTS[1]: "(batch, frames - 1, 3) float32: dT = R_i^T (T_{i+1} - T_i) of the pelvis [m];"
    " T_{i+1} = T_i + R_i dT",
}
"""What goes in and out."""


class _WholeNetwork(nn.Module):
    """From local rotations to the T - 1 motions between T frames."""

    def __init__(self, model: Gmr | MeanGmr) -> None:
        super().__init__()
        self.model = model

    def forward(
        self, local_rotmats: Float[Tensor, "batch frames 23 3 3"]
    ) -> tuple[Float[Tensor, "batch frames-1 3 3"], Float[Tensor, "batch frames-1 3"]]:
        config = self.model.config
        poses = network_input(local_rotmats, config.input, config.extra_inputs)
        # The exporter would else take the example's sizes for those of all inputs.
        poses = poses.reshape(local_rotmats.shape[0], local_rotmats.shape[1], poses.shape[2])
        delta_rotmats, delta_m = self.model(poses)
        return delta_rotmats[:, :-1], delta_m[:, :-1]


def onnx_network(gmr: TrainedGmr) -> bytes:
    """The model file of a network, opset 17, float32, for any batch and two or more frames.

    All sequences of a batch have the same length.  MissingExtra where onnx is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        what = "Install gmrdata with its extra: pip install 'gmrdata[export]'"
        raise MissingExtra(f"an ONNX model needs onnx ({error}). {what}") from None
    example = torch.eye(3).expand(2, 5, N_LOCAL, 3, 3).contiguous()
    stream = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        # On the exporter's age; on shapes that it writes down as constants, which tests look at.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            _WholeNetwork(gmr.model).eval(),  # the exporter puts back the mode that it finds
            (example,),
            stream,  # type: ignore[arg-type]  # its older form takes streams too
            dynamo=False,
            opset_version=OPSET,
            input_names=[INPUT],
            output_names=list(OUTPUTS),
            dynamic_axes={INPUT: {0: "batch", 1: "frames"}}
            | {name: {0: "batch", 1: "motions"} for name in OUTPUTS},
        )
    model = onnx.load_from_string(stream.getvalue())
    _without_shapes(model.graph)
    for output in model.graph.output:
        for dim in output.type.tensor_type.shape.dim[2:]:
            dim.dim_value = 3
    model.producer_name, model.producer_version = "gmrdata", __version__
    onnx.helper.set_model_props(model, _metadata(gmr))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _without_shapes(graph: "onnx.GraphProto") -> None:
    """Forget the exporter's idea of shapes in between.

    It gives the branches of several If nodes the same names for different sizes, which onnxruntime
    takes for one size.
    """
    del graph.value_info[:]
    for branch in (a.g for node in graph.node for a in node.attribute if a.HasField("g")):
        _without_shapes(branch)
        for output in branch.output:
            output.type.tensor_type.ClearField("shape")


def _metadata(gmr: TrainedGmr) -> dict[str, str]:
    """What a user must know, as texts by name."""
    return {
        "gmrdata_version": __version__,
        "run": gmr.name,
        "step": str(gmr.step),
        "fps_hz": f"{gmr.fps_hz:.17g}",
        "joints": ",".join(JOINT_NAMES[1:]),
        "network": gmr.model.config.model_dump_json(),
        **ABOUT,
    }
