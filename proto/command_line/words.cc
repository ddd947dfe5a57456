#include "proto/command_line/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <limits>
#include <utility>

#include "proto/base/count.h"
#include "proto/base/exit_codes.h"
#include "proto/wire/socket.h"

namespace b4mrl {
namespace {

int Refuse(const CLI::App& app, const Status& status) {
  fmt::print(stderr, "{}: {}\n", app.get_name(), status.message());
  return kExitBadUsage;
}

// The error of a word in the place of a command that is none; CLI11's message would not name it.
std::optional<Status> UnknownCommand(const CLI::App& app, const std::vector<std::string>& words) {
  const CLI::App* group = &app;
  for (const std::string& word : words) {
    const std::vector<const CLI::App*> commands = group->get_subcommands({});
    if (commands.empty() || word.starts_with("-")) return std::nullopt;
    std::vector<std::string> names;
    for (const CLI::App* command : commands) names.push_back(command->get_name());
    const auto found = std::ranges::find(names, word);
    if (found == names.end()) return UnknownName("command", word, names);
    group = commands[static_cast<size_t>(found - names.begin())];
  }
  return std::nullopt;
}

// The error of the first word that the command did not take; nothing if it took all. `error` is
// CLI11's, which may say how the word was to be given.
std::optional<Status> UnknownWord(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App* command = &app;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
  const bool has_command = command != &app;
  for (const std::string& word : app.remaining()) {  // those in front of the command
    const std::string name = word.substr(0, word.find('='));
    if (has_command && name.starts_with("--") && command->get_option_no_throw(name) != nullptr) {
      return InvalidArgument("option", name,
                             fmt::format("behind its command, {}", command->get_name()));
    }
  }
  if (command->get_allow_extras()) return std::nullopt;
  const std::vector<std::string> words = app.remaining(/*recurse=*/true);
  if (words.empty()) return std::nullopt;
  if (words[0].starts_with("--")) return UnknownOption(*command, words[0]);
  const std::string allowed = "options and values as in --help";
  const bool lacks_option = dynamic_cast<const CLI::RequiresError*>(&error) != nullptr;
  return InvalidArgument("argument", words[0],
                         lacks_option ? fmt::format("{}; {}", allowed, error.what()) : allowed);
}

// Makes two words of "--name=", behind which CLI11 would take the next word for the value.
void SplitEmptyValues(std::vector<std::string>* words) {
  for (size_t i = 0; i < words->size() && (*words)[i] != "--"; ++i) {
    std::string& word = (*words)[i];
    const bool is_named = word.starts_with("--") && word.size() > 3;
    if (!is_named || word.find('=') != word.size() - 1) continue;
    word.pop_back();
    words->insert(words->begin() + static_cast<std::ptrdiff_t>(i) + 1, "");
  }
}

}  // namespace

CLI::Validator Count(uint64_t low, uint64_t high) {
  return CLI::Validator(CountText(low, high), fmt::format("{}..{}", low, high));
}

CLI::Validator Seed() {
  return CLI::Validator(CountText(0, std::numeric_limits<uint64_t>::max()), "");
}

CLI::Validator Number(double low, double high) {
  const auto check = [low, high](const std::string& text) -> std::string {
    double value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= low && value <= high) return "";
    return fmt::format("{} is not a number in {}..{}", text, low, high);
  };
  return CLI::Validator(check, fmt::format("{}..{}", low, high));
}

CLI::Validator Address() {
  const auto check = [](const std::string& text) { return CheckAddress(text).message(); };
  return CLI::Validator(check, "");
}

Status CheckAddress(std::string_view address) {
  if (address.starts_with("ipc://")) return ParseIpcAddress(address).status();
  const Status not_allowed =
      InvalidArgument("address", address,
                      "tcp://HOST:PORT with a name or an IPv4 address and a port in 1..65535, or "
                      "ipc://PATH");
  const Result<TcpAddress> parsed = ParseTcpAddress(address);
  if (!parsed.ok() || parsed->port == 0) return not_allowed;  // a port that is free is for servers
  const bool is_host = std::ranges::all_of(parsed->host, [](unsigned char c) {
    return std::isalnum(c) != 0 || std::string_view(".-_").find(c) != std::string_view::npos;
  });
  return is_host ? Status() : not_allowed;
}

bool IsOfOption(const Status& status) {
  return status.code() == StatusCode::kInvalidArgument && status.message().starts_with("--");
}

Status UnknownOption(const CLI::App& app, std::string_view option,
                     const std::vector<std::string>& more) {
  std::vector<std::string> names = more;
  for (const CLI::Option* known : app.get_options()) {
    if (known->get_group().empty()) continue;
    for (const std::string& name : known->get_lnames()) names.push_back("--" + name);
  }
  return UnknownName("option", option.substr(0, option.find('=')), names);
}

std::optional<int> ParseWords(CLI::App& app, std::vector<std::string> words) {
  SplitEmptyValues(&words);
  if (const auto unknown = UnknownCommand(app, words)) return Refuse(app, *unknown);
  std::ranges::reverse(words);  // as CLI11 takes them
  try {
    app.parse(std::move(words));
    return std::nullopt;
  } catch (const CLI::ParseError& error) {
    const bool is_fault = error.get_exit_code() != 0;  // and not a call for help
    // A misspelt option may show as a missing one.
    const auto unknown = UnknownWord(app, error);
    if (is_fault && unknown) return Refuse(app, *unknown);
    // Prints help and version to stdout, errors to stderr.
    return app.exit(error) == 0 ? kExitDone : kExitBadUsage;
  }
}

}  // namespace b4mrl
