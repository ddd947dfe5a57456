// b4mrl-serve: the daemon, or one of its children when the supervisor started it with --role.
#pragma once

namespace b4mrl {

// The program's main function; returns its exit code. Apart from main.cc so that tests can build
// the same program with faults in it.
int ServeMain(int argc, char** argv);

}  // namespace b4mrl
