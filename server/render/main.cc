#include "server/render/painter.h"

int main() { return b4mrl::RunPainter(); }
