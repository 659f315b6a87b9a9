"""What the figures mean and where they end, as HTML."""

MEANINGS = (
    (
        "A motion",
        "How the body turns and moves from one frame to the next, in its own frame: T frames give "
        "T − 1 motions. R is the root’s orientation and T the pelvis’ position in the world "
        "(eqs. 2–4).",
        "ΔR<sub>i</sub> = R<sub>i</sub><sup>⊤</sup> R<sub>i+1</sub>,&emsp;"
        "ΔT<sub>i</sub> = R<sub>i</sub><sup>⊤</sup> (T<sub>i+1</sub> − T<sub>i</sub>)",
    ),
    (
        "OME, orientation motion error [°]",
        "The angle between the estimated and the true turn, averaged over all motions (eq. 15).",
        "mean<sub>i</sub> ‖ log( ΔR*<sub>i</sub> ΔR<sub>i</sub><sup>⊤</sup> ) ‖",
    ),
    (
        "TME, translation motion error [mm]",
        "The distance between the estimated and the true step, averaged over all motions (eq. 16).",
        "mean<sub>i</sub> ‖ ΔT<sub>i</sub> − ΔT*<sub>i</sub> ‖",
    ),
    (
        "VME, vertex motion error [mm]",
        "The body in its pose, turned and moved by one motion from the origin: how far its "
        "vertices then lie from where the true motion takes them, averaged over all motions and "
        "vertices (eq. 17).",
        "mean<sub>i,j</sub> ‖ ΔM<sub>i</sub>[j] − ΔM*<sub>i</sub>[j] ‖",
    ),
    (
        "Camera rotation error [°]",
        "The angle between the recovered and the true orientation of the camera, averaged over the "
        "frames, after one rotation A of the whole recovered world onto the true one.",
        "mean<sub>i</sub> ∠( A C<sub>i</sub>, C*<sub>i</sub> )",
    ),
    (
        "Scale error [%]",
        "A moving camera alone gives its path only up to a factor; the size of the body and its "
        "feet on the floor give metres. This is that factor against the truth. A camera that only "
        "turns has no path, so no scale enters.",
        "100 · ( recovered / true − 1 )",
    ),
)
"""(name, words, equation) per figure."""

LIMITS = (
    "OME, TME and VME compare steps, not paths: a small error that always points the same way "
    "bends a long path more than these figures show. The views from above show that.",
    "The figures are per motion, so they depend on the frame rate. Compare them only with figures "
    "at the same rate.",
    "The reconstruction is given the body in the camera’s frame. Where that is the truth, as for a "
    "rendered clip, the errors here are those of cameras and scale alone; on a real video the "
    "body’s own error adds to them.",
    "Rendered frames are sharp, evenly lit and rich in texture. Real video is harder.",
)
"""Sentences that hold for every report."""
