"""Limits and times of the protocol, equal to those of proto/base/limits.h; a test compares them."""

PROTOCOL_VERSION = 1

# Messages.
MAX_ENVELOPE_BYTES = 64 * 1024
MAX_PAYLOAD_BYTES = 64 * 1024 * 1024
MAX_ARRAYS_PER_MESSAGE = 32
MAX_ARRAY_DIMENSIONS = 8
ARRAY_ALIGNMENT = 64  # bytes, of an array's offset within the payload

# Sessions and lanes.
TOKEN_BYTES = 16
MAX_REQUESTS_IN_FLIGHT = 64  # of one connection
MAX_QUERY_ROWS = 4096  # of one request
MAX_ROWS_PER_BATCH = 65536  # of one Sample or Read
MAX_OBSERVATION_DIMENSIONS = 4096
MAX_ACTION_DIMENSIONS = 1024
MAX_LANES_PER_SESSION = 1024
MIN_PICTURE_SIDE = 16  # pixels
MAX_PICTURE_SIDE = 1920

# Time.
MAX_DEADLINE_MS = 3_600_000
HANDSHAKE_MS = 3_000
DIRECT_CONNECT_MS = 1_000  # without a connection by then, requests go through the gateway
HEARTBEAT_INTERVAL_MS = 2_000
HEARTBEAT_TIMEOUT_MS = 6_000
HEARTBEAT_TTL_MS = 10_000

# Messages queued in a socket before sending fails.
HIGH_WATER_MARK = 1_000

# The local door.
MIN_RING_BYTES = 64 * 1024  # of each of a connection's two rings
MAX_RING_BYTES = 1024 * 1024
MAX_SPIN_US = 10_000
