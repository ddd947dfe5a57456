// A program in the model compiler's place, which does at once what a file's name says: "slow..."
// never ends, "refused..." is refused, the rest is taken. Each run is a line in a log.
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <string>

#include "server/gateway/model_store.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {

class CompilerScript {
 public:
  CompilerScript() {
    std::filesystem::create_directories(models());
    WriteBytes(program(), R"(#!/bin/sh
folder=$4 file=$6 cache=${10} trial=${12}
echo "$file" >> "$folder/../log"
echo "$trial" >> "$folder/../trials"
case "$file" in
slow*) exec tail -f /dev/null ;;
refused*) echo '{"ok": false, "code": 1, "message": "as its name says"}'; exit 3 ;;
esac
: > "$cache/00000000000000000000000000000001.mjb"
echo '{"ok": true, "hash": "00000000000000000000000000000001"}'
)");
    chmod(program().c_str(), 0700);
  }

  std::string models() const { return folder_.File("models"); }
  ModelStore::Options options() const { return {models(), folder_.File("data"), program()}; }
  void Drop(const std::string& file, const std::string& text = "<mujoco/>") const {
    WriteBytes(models() + "/" + file, text);
  }
  // The names of the files in which models were tried out, a line each.
  std::string trials() const { return ReadBytes(folder_.File("trials")); }
  // How often `file` was compiled, or all of them.
  size_t runs(const std::string& file = "") const {
    const std::string log = ReadBytes(folder_.File("log"));
    size_t count = 0;
    for (size_t at = 0; at < log.size(); at = log.find('\n', at) + 1) {
      count += file.empty() || log.compare(at, file.size() + 1, file + "\n") == 0;
    }
    return count;
  }

 private:
  std::string program() const { return folder_.File("compiler"); }

  TemporaryFolder folder_;
};

}  // namespace b4mrl
