// model=FILE.xml: a model of the user's in place of the task's own. FILE.xml lies in the models
// folder and has the task's joints and motors; everything else may differ. Wherever `model` stands
// in the list of perturbations, it applies first: the others change the user's model.
//
// The file itself is never read here. A sandboxed process compiles it and tries it out
// (server/models/model_compiler.h), and simulators load the compiled copy.
#include <algorithm>

#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

constexpr const char* kName = "model";

class UsersModel final : public Perturbation {
 public:
  explicit UsersModel(std::string file) : file_(std::move(file)) {}
  NamedArgument ToNamedArgument() const override { return {kName, file_}; }
  std::string_view model_file() const override { return file_; }

 private:
  std::string file_;
};

Result<std::unique_ptr<Perturbation>> Make(const PerturbationInput& input) {
  if (!IsModelFileName(input.argument)) {
    return InvalidArgument(kName, input.argument,
                           "NAME.xml, a file in the models folder; letters, digits, '-', '_', '.'");
  }
  if (input.occurrence > 0) {
    return InvalidNumber("number of models", static_cast<double>(input.occurrence + 1),
                         "1: model=FILE.xml may be given once");
  }
  return std::unique_ptr<Perturbation>(std::make_unique<UsersModel>(std::string(input.argument)));
}

}  // namespace

bool IsModelFileName(std::string_view name) {
  constexpr size_t kMaxLength = 100;
  const auto plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '_' || c == '.';
  };
  return name.size() <= kMaxLength && name.size() > 4 && name.ends_with(".xml") && name[0] != '.' &&
         std::ranges::all_of(name, plain);
}

extern const PerturbationEntry kUsersModel;  // its line in list.cc
constinit const PerturbationEntry kUsersModel = {
    .name = kName,
    .parameter = "file",
    .type = "file",
    .description = "replaces the task's MuJoCo model by a file of the models folder",
    .needs = kMujocoModel,
    .make = Make};

}  // namespace b4mrl
