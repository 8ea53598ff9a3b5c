"""Names and numbers of a policy's files, in a module of their own so that driving an arm does not load training code."""

FORMAT = 1
WEIGHTS, SPEC = "policy.safetensors", "policy.json"
PROPRIO_NAMES = (
    *("tool_x", "tool_y", "tool_z", "tool_yaw_sine", "tool_yaw_cosine", "aperture"),
    *("lag_x", "lag_y", "lag_z", "lag_yaw", "lag_aperture", "aperture_change"),
)
ACTION_NAMES = ("x", "y", "z", "yaw", "aperture")
INPUTS, OUTPUTS = ("image", "proprio"), ("action",)
"""Names in `policy.onnx`."""
