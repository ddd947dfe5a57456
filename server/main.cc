#include "proto/command_line/program.h"
#include "server/serve_main.h"

int main(int argc, char** argv) {
  return b4mrl::RunProgram("b4mrl serve", [=] { return b4mrl::ServeMain(argc, argv); });
}
