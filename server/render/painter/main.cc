#include <cstdlib>

#include "server/render/painter/painter.h"

// Without exit handlers: Mesa's and LLVM's have nothing to save, and must not turn an end in order
// into a crash.
int main() { std::_Exit(b4mrl::RunPainter()); }
