// The bounds of what clients may ask for, in one place; those of a dataset file's import stand with
// the importer (server/datasets/importer.cc). Hello sends clients the bounds that concern them. A
// request that finds the daemon full is answered with kLimitExceeded, a request that is too large
// by itself with kInvalidArgument; both errors name the limit.
#pragma once

#include <cstddef>
#include <cstdint>

namespace b4mrl::limits {

inline constexpr uint32_t kProtocolVersion = 1;

// Messages.
inline constexpr size_t kMaxEnvelopeBytes =
    64 * 1024;  // frame 1, which takes at most 5.2 MiB of memory once parsed
inline constexpr size_t kMaxPayloadBytes = 64 * 1024 * 1024;  // frame 2
inline constexpr size_t kMaxFramesPerMessage = 2;             // not counting ZeroMQ's routing id
inline constexpr size_t kMaxArraysPerMessage = 32;
inline constexpr size_t kMaxArrayDimensions = 8;
inline constexpr size_t kArrayAlignment = 64;  // bytes: of the arrays' offsets within frame 2

// Sessions and lanes.
inline constexpr size_t kTokenBytes = 16;
inline constexpr uint32_t kMaxSessions = 1024;
inline constexpr uint32_t kMaxLanesPerSession = 1024;
inline constexpr uint32_t kMaxLanes = 8192;               // lanes of all sessions together
inline constexpr size_t kLaneBufferBytes = 16 * 1024;     // size of each of a lane's two records
inline constexpr uint32_t kMaxLedgers = 1024;             // open at once
inline constexpr size_t kMaxOpenRequestBytes = 8 * 1024;  // as a client sends it
// Opens are kept for replacement workers, with their seed, dtype and path of a compiled model.
inline constexpr size_t kMaxOpenRecordBytes = kMaxOpenRequestBytes + 4 * 1024 + 64;
inline constexpr uint32_t kMaxPerturbations = 16;       // of one session
inline constexpr uint32_t kMaxCatalogueEntries = 4096;  // that a client takes from a server
inline constexpr uint32_t kMaxRequestsInFlight = 64;    // of one session, in one worker
inline constexpr uint32_t kMaxQueuedRequests = 4096;    // of all sessions, in one worker
inline constexpr size_t kMaxQueuedBytes = 16 * kMaxPayloadBytes;  // payloads of queued requests
inline constexpr size_t kMaxSessionBytes = 2 * kMaxPayloadBytes;  // of them, those of one session
inline constexpr uint32_t kMaxQueryRows = 4096;                   // of one Query request
inline constexpr uint32_t kMaxRowsPerBatch = 65536;               // of one Sample batch or one Read
inline constexpr uint32_t kMaxBatchesPerSample = 64;
inline constexpr int64_t kLoopbackLeaseMs = 3'600'000;  // default of a server on loopback alone
inline constexpr int64_t kRemoteLeaseMs = 300'000;      // default of a server on a network
inline constexpr uint32_t kMaxLeaseSeconds = 30 * 86'400;
inline constexpr uint32_t kMinMemoryMib = 64;  // a process without sessions takes 3
inline constexpr uint32_t kMaxMemoryMib = 1u << 30;

// Time.
inline constexpr int64_t kDefaultDeadlineMs = 10'000;
inline constexpr int64_t kMaxDeadlineMs = 3'600'000;
inline constexpr int64_t kHandshakeMs = 3'000;
inline constexpr int64_t kHeartbeatIntervalMs = 2'000;
inline constexpr int64_t kHeartbeatTimeoutMs = 6'000;
inline constexpr int64_t kHeartbeatTtlMs = 10'000;
// Times without a heartbeat after which a child is replaced.
inline constexpr int64_t kFrozenChildMs = 2'000;
inline constexpr int64_t kStarvedChildMs = 30'000;  // if the child gets no processor time
inline constexpr int64_t kDrainMs = 5'000;          // for requests under way after a SIGTERM

// Sockets: messages queued towards one peer before the peer counts as too slow; and unread bytes of
// a server, which are queued envelopes and payloads of kCountedFrameBytes or more. A process that
// is allowed little memory has lower limits for these bytes, and for those of requests
// (server/process/memory_shares.h).
inline constexpr int kHighWaterMark = 1'000;
inline constexpr size_t kCountedFrameBytes = 1024;
inline constexpr size_t kMaxUnreadBytes = 16 * kMaxPayloadBytes;       // towards one peer
inline constexpr size_t kMaxUnreadBytesOfAll = 64 * kMaxPayloadBytes;  // towards all peers
inline constexpr size_t kReservedUnreadBytes = 64 * 1024;              // of them, for each peer

// The local door: rings of shared memory between a client and a worker of one machine. A connection
// takes 516 KiB.
inline constexpr uint32_t kMaxDoors = 256;  // connections of one worker; further ones use ZeroMQ
inline constexpr uint32_t kRingBytes = 256 * 1024;    // of each of a connection's two rings
inline constexpr uint32_t kMinRingBytes = 64 * 1024;  // that a client accepts
inline constexpr uint32_t kMaxRingBytes = 1024 * 1024;
inline constexpr uint32_t kMaxDoorBells = 10'000;  // without a byte in either ring
// Longest spin before a sleep. A step of Humanoid, or of eight environments, takes 200 us.
inline constexpr uint32_t kDefaultSpinUs = 250;
inline constexpr uint32_t kMaxSpinUs = 10'000;

// Replies with rows that a dataset worker fills at once: of small ones, and of large ones.
inline constexpr size_t kMaxFilledBytes = 8 * kMaxPayloadBytes;

// Opens that wait in the gateway for a worker or a model.
inline constexpr uint32_t kMaxPendingOpensOfPeer = 256;  // of one connection
inline constexpr uint32_t kMaxPendingOpens = 16'384;     // of all connections

// The gateway's relay: a client that reaches no other port has one route for each of its sessions.
// Bytes are counted over relayed requests that are not answered yet.
inline constexpr int64_t kDirectConnectMs = 1'000;  // for a client to reach a worker's own port
inline constexpr uint32_t kMaxRelayRoutes = 1024;
inline constexpr size_t kMaxRelayRouteBytes = 2 * kMaxPayloadBytes;  // of one route
inline constexpr size_t kMaxRelayBytes = 16 * kMaxPayloadBytes;      // of all routes
inline constexpr int64_t kRelayIdleMs = 60'000;  // time without use after which a route is removed

// Pictures.
inline constexpr uint32_t kMinPictureSide = 16;  // pixels
inline constexpr uint32_t kMaxPictureSide = 1920;
inline constexpr uint32_t kMaxRenderRequests = 16;  // in one worker, at most 64 MiB of frames each
inline constexpr uint32_t kMaxSessionRenders = 4;   // of one session
// For a painter to draw one picture, by the clock and of its processor time. On an idle machine it
// draws its first picture in 1 s, later pictures in 30 ms, the largest in 300 ms.
inline constexpr int64_t kPaintMs = 60'000;
inline constexpr int64_t kPaintProcessorMs = 5'000;
// A simulator with so many pictures that took more processor time, each less than kPaintRefusalMs
// after the one before, is not drawn for that long.
inline constexpr uint32_t kMaxSlowPictures = 2;
inline constexpr int64_t kPaintRefusalMs = 120'000;
// By the clock, from its beginning, for a picture whose deadline has passed and whose painter is
// wanted for the next one. It may be a painter's first, which the next is spared.
inline constexpr int64_t kLatePictureMs = 10'000;
// For an answer whose first byte has come.
inline constexpr int64_t kPaintAnswerMs = 2'000;
inline constexpr int64_t kPainterIdleMs = 60'000;  // time without use after which a painter ends

// Processes.
inline constexpr uint32_t kMaxWorkers = 64;
inline constexpr uint32_t kMaxThreads = 256;

// Models of users (model=FILE.xml), which a sandboxed process compiles.
inline constexpr uint32_t kMaxModelFiles = 512;          // of a models folder in the catalogue
inline constexpr size_t kMaxModelFileBytes = 1 << 20;    // of an MJCF file; meshes may be longer
inline constexpr size_t kMaxModelReferences = 256;       // includes, meshes, textures and folders
inline constexpr size_t kMaxModelBytes = 16 << 20;       // size of a compiled model
inline constexpr size_t kMaxSimulationBytes = 64 << 20;  // of one model's mjData
inline constexpr uint64_t kMaxModelCompilerBytes = 512ull << 20;
inline constexpr uint64_t kMaxModelCompilerSeconds = 5;  // of processor time
inline constexpr int64_t kModelCompilerMs = 60'000;
inline constexpr uint32_t kModelCompilers = 4;          // compiler processes that run at once
inline constexpr int64_t kQuickModelMs = 500;           // a slower model makes room for the next
inline constexpr uint32_t kMaxPendingModels = 64;       // models being compiled or waiting for it
inline constexpr uint32_t kMaxPendingModelsOfPeer = 8;  // pending models of one connection
inline constexpr uint32_t kMaxCompiledModels = 1024;    // compiled models kept on disk

// Datasets.
inline constexpr uint64_t kMaxDatasetRows = 100'000'000;
inline constexpr uint32_t kMaxObservationDimensions = 4096;
inline constexpr uint32_t kMaxActionDimensions = 1024;
inline constexpr uint32_t kMaxDatasets = 4096;               // files in a data folder
inline constexpr size_t kMaxNewDatasetNameBytes = 200;       // a file's name has 255 at most
inline constexpr uint32_t kMaxPendingDatasetRequests = 256;  // waiting for a file or corruption
inline constexpr uint32_t kMaxPendingDatasetRequestsOfPeer = 64;  // of them, of one connection
inline constexpr size_t kMaxKeptRequestBytes = 32 * 1024;         // of such a request, once parsed
inline constexpr uint32_t kMaxMappedDatasets = 64;       // others are mapped again when used
inline constexpr uint32_t kDefaultCacheMib = 64 * 1024;  // of disk, for all of their caches
inline constexpr uint32_t kMaxCacheMib = 1u << 30;

}  // namespace b4mrl::limits
