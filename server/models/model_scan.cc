#include "server/models/model_scan.h"

#include <fmt/format.h>
#include <tinyxml2.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <string_view>
#include <vector>

#include "data/files/atomic_file.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// An attribute of an element: "file" in line 12 of "hopper.xml".
struct Reference {
  std::string place;  // "hopper.xml, line 12"
  std::string path;   // as written
};

bool IsAbsolute(std::string_view path) {
  return path.starts_with('/') || path.starts_with('\\') || path.find(':') != path.npos;
}

bool GoesUp(std::string_view path) {
  while (!path.empty()) {
    const size_t end = std::min(path.find_first_of("/\\"), path.size());
    if (path.substr(0, end) == "..") return true;
    path.remove_prefix(std::min(end + 1, path.size()));
  }
  return false;
}

Status Leaves(const Reference& reference) {
  return InvalidArgument(reference.place + ": a reference", reference.path,
                         "files inside the models folder, by relative paths without '..'");
}

// Collects the references of one file and its includes.
class Scan final : public tinyxml2::XMLVisitor {
 public:
  Scan(std::string folder, const std::string& file_name)
      : folder_(std::move(folder)), files_({{file_name, file_name}}) {}

  // Includes are found relative to the folder, wherever the including file lies.
  Status ReadFile(const std::string& name);
  // Whether any combination of a folder and a file leads outside.
  Status CheckLinks() const;

 private:
  bool VisitEnter(const tinyxml2::XMLElement& element,
                  const tinyxml2::XMLAttribute* first) override;
  void Note(const tinyxml2::XMLElement& element, const tinyxml2::XMLAttribute& attribute);
  void Fail(Status status) {
    if (status_.ok()) status_ = std::move(status);
  }

  std::string folder_;
  std::string current_;  // the file being read
  Status status_;
  std::vector<Reference> files_;
  std::vector<std::string> folders_ = {"."};
  std::vector<Reference> includes_;  // of the current file
  std::set<std::string> seen_;
};

bool Scan::VisitEnter(const tinyxml2::XMLElement& element, const tinyxml2::XMLAttribute* first) {
  for (const auto* attribute = first; attribute != nullptr; attribute = attribute->Next()) {
    Note(element, *attribute);
  }
  return status_.ok();
}

void Scan::Note(const tinyxml2::XMLElement& element, const tinyxml2::XMLAttribute& attribute) {
  const std::string_view name = attribute.Name();
  const bool is_folder = name.ends_with("dir") && std::string_view(element.Name()) == "compiler";
  if (!name.starts_with("file") && !is_folder) return;
  const Reference reference{fmt::format("{}, line {}", current_, attribute.GetLineNum()),
                            attribute.Value()};
  if (IsAbsolute(reference.path) || GoesUp(reference.path)) return Fail(Leaves(reference));
  if (files_.size() + folders_.size() >= limits::kMaxModelReferences) {
    return Fail(InvalidArgument(reference.place + ": references", "more",
                                std::to_string(limits::kMaxModelReferences)));
  }
  if (is_folder) {
    folders_.push_back(reference.path);
  } else {
    files_.push_back(reference);
    if (std::string_view(element.Name()) == "include") includes_.push_back(reference);
  }
}

Status Scan::ReadFile(const std::string& name) {
  if (!seen_.insert(name).second) return Status();  // MuJoCo itself refuses a second inclusion
  B4MRL_ASSIGN_OR_RETURN(const std::string text,
                         ReadSmallFile(folder_ + "/" + name, limits::kMaxModelFileBytes));
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{}, line {}: not well-formed ({})", name, document.ErrorLineNum(),
                              document.ErrorName()));
  }
  const tinyxml2::XMLElement* root = document.RootElement();
  const std::string_view root_name = root != nullptr ? root->Name() : "";
  const bool included = seen_.size() > 1;  // then its root may have any name
  if (root == nullptr || (root_name != "mujoco" && !included)) {
    return InvalidArgument(name + ": the root element", root_name, "mujoco");
  }
  current_ = name;
  includes_.clear();
  document.Accept(this);
  B4MRL_RETURN_IF_ERROR(status_);
  const std::vector<Reference> includes = std::move(includes_);
  for (const Reference& include : includes) {
    std::error_code error;
    if (!fs::is_regular_file(folder_ + "/" + include.path, error)) {
      return InvalidArgument(include.place + ": included file", include.path, "a file that exists");
    }
    B4MRL_RETURN_IF_ERROR(CheckLinks());
    B4MRL_RETURN_IF_ERROR(ReadFile(include.path));
  }
  return Status();
}

Status Scan::CheckLinks() const {
  std::error_code error;
  const std::string inside = fs::canonical(folder_, error).string() + "/";
  if (error) return IoError("open models folder", folder_, error.value());
  for (const std::string& folder : folders_) {
    for (const Reference& file : files_) {
      const fs::path found = fs::canonical(fs::path(folder_) / folder / file.path, error);
      // MuJoCo itself refuses references to files that do not exist.
      if (!error && !found.string().starts_with(inside)) return Leaves(file);
    }
  }
  return Status();
}

}  // namespace

Status ScanModelFile(const std::string& models_folder, const std::string& file_name) {
  Scan scan(models_folder, file_name);
  B4MRL_RETURN_IF_ERROR(scan.CheckLinks());
  B4MRL_RETURN_IF_ERROR(scan.ReadFile(file_name));
  return scan.CheckLinks();
}

}  // namespace b4mrl
