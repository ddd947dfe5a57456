// The program b4mrl-render: draws lanes for one environment worker, which started it and speaks to
// it over the socket that is its stdin (paint_messages.h).
//
// It is a process of its own because Mesa must not be able to end, block or slow down a worker: it
// brings LLVM along, its contexts are bound to a thread, a picture takes a thousand times as long
// as a step, and it runs at lower priority. It keeps caches alone: simulators and OpenGL contexts
// of the last few kinds of picture. The program ends with its worker, when no picture has been
// asked for in limits::kPainterIdleMs, and by SIGPROF when one takes more than
// limits::kPaintProcessorMs of processor time.
#pragma once

namespace b4mrl {

// The program's main function; returns the exit code, 0 if the worker is gone or asked for nothing.
int RunPainter();

}  // namespace b4mrl
