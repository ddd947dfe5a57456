#include <cstdlib>

#include "server/render/painter/painter.h"

// Skips exit handlers: Mesa's and LLVM's have nothing to save, and must not turn a normal end into
// a crash.
int main() { std::_Exit(b4mrl::RunPainter()); }
