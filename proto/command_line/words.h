// How the programs read their command lines with CLI11: the values of options, and what they say of
// a misspelt word. Thread rule: one thread.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Each of these accepts one kind of value: `app.add_option(...)->transform(Count(1, 9))`.

// A whole number in low..high, written as proto/base/count.h allows.
CLI::Validator Count(uint64_t low, uint64_t high);
// Any unsigned 64-bit number, in the same notation.
CLI::Validator Seed();
// A number in low..high, of which NaN is none.
CLI::Validator Number(double low, double high);
// An address of a daemon, as CheckAddress takes it.
CLI::Validator Address();

// OK for "tcp://HOST:PORT" and "ipc://PATH", to which a client can connect; kInvalidArgument for
// others, as for "", which would stand for none.
Status CheckAddress(std::string_view address);

// The error "unknown option '--updats'; did you mean '--updates'?", with the options of `app` that
// its help shows and the names in `more` as known names.
Status UnknownOption(const CLI::App& app, std::string_view option,
                     const std::vector<std::string>& more = {});

// Whether a value or a use of an option is refused: kInvalidArgument whose message begins with it.
bool IsOfOption(const Status& status);

// Parses the words behind the program's name. Returns nothing if the program is to go on, else its
// exit code: help and the version are on stdout, or an error is on stderr, behind the name of
// `app`. A word that is no command or no option is named, with the nearest one. "--name=" gives an
// empty value, as "--name" and "" do.
std::optional<int> ParseWords(CLI::App& app, std::vector<std::string> words);

}  // namespace b4mrl
