#include "server/serve_main.h"

int main(int argc, char** argv) { return b4mrl::ServeMain(argc, argv); }
