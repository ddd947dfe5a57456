"""The classes of the protocol's messages, made from b4mrl.proto, which the package carries.

`Request` and `Reply` are the two envelopes; proto/PROTOCOL.md says what their fields mean.
"""

from __future__ import annotations

import warnings
from importlib import resources

from google.protobuf.internal import api_implementation

from b4mrl.wire import proto_file

_CLASSES = proto_file.load(
    resources.files("b4mrl.wire").joinpath("b4mrl.proto").read_text(encoding="utf-8"), "b4mrl.proto"
)

Request = _CLASSES["Request"]
Reply = _CLASSES["Reply"]
AUTORESET_MODES = _CLASSES["OpenRequest"].DESCRIPTOR.fields_by_name["autoreset_mode"].enum_type
CAUSES = Request.DESCRIPTOR.file.enum_types_by_name["Cause"]

if api_implementation.Type() == "python":
    warnings.warn(
        "protobuf runs without its compiled part here, so that reading a message takes about 30 us "
        "instead of 1 us. To have the compiled part, install protobuf's binary wheel.",
        RuntimeWarning,
        stacklevel=2,
    )
