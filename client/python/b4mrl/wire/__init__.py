"""Requests and replies between this process and a daemon; nothing here knows Gymnasium.

From the bottom up: `messages` are the envelopes, `arrays` the payloads; a `link` carries both,
through ZeroMQ (`sockets`) or through shared memory (`door`); a `connection` sends requests and
receives replies; `operations` execute each step exactly once; a `session` is a batch of
environments. These modules import no other module of the package but `errors`.
"""
