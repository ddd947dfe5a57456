#include "algorithms/tools/config_file.h"

#include <fmt/format.h>

#include <algorithm>

#include "data/files/toml_file.h"

namespace b4mrl {
namespace {

constexpr std::string_view kOption = "--config";

Result<std::vector<std::string>> ReadOptions(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table table, ReadTomlFile(path));
  std::vector<std::string> options;
  for (const auto& [key, value] : table) {
    const std::string name = fmt::format("--{}", key.str());
    if (const auto* flag = value.as_boolean()) {
      options.push_back(fmt::format("{}={}", name, flag->get()));
    } else if (const auto* string = value.as_string()) {
      options.push_back(fmt::format("{}={}", name, string->get()));
    } else if (const auto* integer = value.as_integer()) {
      options.push_back(fmt::format("{}={}", name, integer->get()));
    } else if (const auto* number = value.as_floating_point()) {
      options.push_back(fmt::format("{}={}", name, number->get()));
    } else {
      return InvalidArgument(fmt::format("{} in {}", key.str(), path), "a table, array or date",
                             "a string, number or boolean");
    }
  }
  return options;
}

std::vector<std::string>::iterator FindOption(std::vector<std::string>& arguments) {
  return std::ranges::find_if(arguments, [](const std::string& word) {
    return word == kOption || word.starts_with(std::string(kOption) + "=");
  });
}

}  // namespace

Result<std::vector<std::string>> ExpandConfigFile(std::vector<std::string> arguments) {
  const auto found = FindOption(arguments);
  if (found == arguments.end()) return arguments;
  std::string path;
  if (*found == kOption) {
    if (found + 1 == arguments.end()) return InvalidArgument(kOption, "", "a file");
    path = *(found + 1);
    arguments.erase(found, found + 2);
  } else {
    path = found->substr(kOption.size() + 1);
    arguments.erase(found);
  }
  if (FindOption(arguments) != arguments.end()) {
    return InvalidArgument(kOption, "given twice", "one file");
  }
  B4MRL_ASSIGN_OR_RETURN(const std::vector<std::string> options, ReadOptions(path));
  // Insert the file's options after the command's word, before all other arguments.
  const auto place = arguments.begin() + (arguments.empty() ? 0 : 1);
  arguments.insert(place, options.begin(), options.end());
  return arguments;
}

}  // namespace b4mrl
