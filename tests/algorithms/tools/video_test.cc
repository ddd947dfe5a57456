// `b4mrl evaluate --video`: a film of the first episode, and what happens where there can be none.
#include <sys/stat.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "data/d4rl/agent_file.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

// A Hopper agent that pushes all joints one way, and so falls within a hundred steps.
std::string WriteFallingAgent(const TemporaryFolder& folder) {
  Agent agent;
  agent.observation_dimensions = 11;
  agent.action_dimensions = 3;
  agent.hidden = {{11, 1, std::vector<float>(11), {1}}};
  agent.last_fc = {1, 3, {1, 1, 1}, {0, 0, 0}};
  agent.output_distribution = OutputDistribution::kTanh;
  const std::string path = folder.File("falls.h5");
  REQUIRE(WriteAgent(path, agent).ok());
  return path;
}

Words Evaluate(const std::string& agent, const std::string& video) {
  return {"evaluate",   "--agent", agent,    "--environment", "Hopper",
          "--episodes", "2",       "--json", "--video",       video};
}

// What ffprobe says of the film: "width,height,frames a second as a fraction,frames".
std::string Probe(const std::string& path) {
  const std::string command =
      "ffprobe -v error -count_frames -select_streams v -of csv=p=0 -show_entries "
      "stream=width,height,avg_frame_rate,nb_read_frames '" +
      path + "'";
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  REQUIRE(pipe != nullptr);
  std::string text;
  for (int c = 0; (c = std::fgetc(pipe.get())) != EOF && c != '\n';) text += static_cast<char>(c);
  return text;
}

// The names in a folder, hidden ones included, in order.
Words FilesIn(const std::string& folder) {
  Words names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.push_back(entry.path().filename());
  }
  std::ranges::sort(names);
  return names;
}

TEST_CASE("A film has one picture for the start and one for each step of the first episode") {
  if (std::system("ffmpeg -version > /dev/null 2>&1") != 0) {
    WARN("skipped: ffmpeg is not installed");
    return;
  }
  TemporaryFolder folder;
  const std::string video = folder.File("hopper.mp4");
  const Outcome outcome = Run(Evaluate(WriteFallingAgent(folder), video));
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
  const auto result = nlohmann::json::parse(outcome.out, nullptr, false);
  REQUIRE(result.is_object());
  const int length = result["lengths"][0].get<int>();
  CHECK(length < 200);
  CHECK(Probe(video) == "480,480,125/1," + std::to_string(length + 1));
}

TEST_CASE("A film does not change the scores") {
  if (std::system("ffmpeg -version > /dev/null 2>&1") != 0) {
    WARN("skipped: there is no ffmpeg");
    return;
  }
  TemporaryFolder folder;
  const std::string agent = WriteFallingAgent(folder);
  const Outcome filmed = Run(Evaluate(agent, folder.File("hopper.mp4")));
  Words plain = Evaluate(agent, "");
  plain.resize(plain.size() - 2);
  const Outcome scored = Run(plain);
  CHECK((filmed.exit_code == 0 && scored.exit_code == 0));
  CHECK(filmed.out == scored.out);
}

TEST_CASE("A film replaces a file only where it may, and only once it is whole") {
  TemporaryFolder folder;
  const std::string agent = WriteFallingAgent(folder);
  const std::string notes = folder.File("notes.txt");  // no film has this ending
  WriteBytes(notes, "mine");
  const Outcome refused = Run(Evaluate(agent, notes));
  CHECK(refused.exit_code == 3);
  CHECK(refused.err.find("--video is '" + notes + "', allowed: a new file, or --replace") !=
        std::string::npos);
  for (const std::string& file : {notes, agent}) {
    const std::string before = ReadBytes(file);
    Words words = Evaluate(agent, file);
    words.emplace_back("--replace");
    CHECK(Run(words).exit_code == 3);
    CHECK(ReadBytes(file) == before);
  }
  CHECK(FilesIn(folder.path()) == Words{"falls.h5", "notes.txt"});

  Words alone = Evaluate(agent, "");
  alone.resize(alone.size() - 2);
  alone.emplace_back("--replace");
  CHECK(Run(alone).exit_code == 2);
  if (std::system("ffmpeg -version > /dev/null 2>&1") != 0) return;
  const std::string video = folder.File("hopper.mp4");
  WriteBytes(video, "an older film");
  Words words = Evaluate(agent, video);
  words.emplace_back("--replace");
  CHECK(Run(words).exit_code == 0);
  CHECK(Probe(video).starts_with("480,480,"));
  CHECK(FilesIn(folder.path()) == Words{"falls.h5", "hopper.mp4", "notes.txt"});
}

TEST_CASE("A film that ffmpeg gives up leaves the file in its place as it was") {
  TemporaryFolder folder;
  const std::string agent = WriteFallingAgent(folder);
  const std::string video = folder.File("hopper.mp4");
  WriteBytes(video, "an older film");
  // Begins its file, the last argument, and fails.
  const std::string program = folder.File("ffmpeg");
  WriteBytes(program, "#!/bin/sh\nfor file; do :; done\necho begun > \"${file#file:}\"\nexit 1\n");
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  Words words = Evaluate(agent, video);
  words.emplace_back("--replace");
  const Outcome outcome = Run(words, {"PATH=" + folder.path()});
  CHECK(outcome.exit_code == 3);
  CHECK(outcome.err.find("ffmpeg cannot write " + video) != std::string::npos);
  CHECK(ReadBytes(video) == "an older film");
  CHECK(FilesIn(folder.path()) == Words{"falls.h5", "ffmpeg", "hopper.mp4"});
}

TEST_CASE("A file that appears while a film is made is kept, and replaced only where it may be") {
  TemporaryFolder folder;
  const std::string agent = WriteFallingAgent(folder);
  const std::string video = folder.File("hopper.mp4");
  // Takes the pictures, puts a file where the film is to go, and makes its last argument.
  const std::string program = folder.File("ffmpeg");
  const std::string begin = "#!/bin/sh\nfor file; do :; done\n/bin/cat > /dev/null\n";
  WriteBytes(program, begin + "echo mine > '" + video + "'\necho film > \"${file#file:}\"\n");
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  Words words = Evaluate(agent, video);
  const Outcome kept = Run(words, {"PATH=" + folder.path()});
  INFO(kept.err);
  CHECK(kept.exit_code == 3);
  CHECK(Says(kept.err, video + " appeared in the meantime and is kept"));
  CHECK(ReadBytes(video) == "mine\n");
  words.emplace_back("--replace");
  CHECK(Run(words, {"PATH=" + folder.path()}).exit_code == 0);
  CHECK(ReadBytes(video) == "film\n");
  CHECK(FilesIn(folder.path()) == Words{"falls.h5", "ffmpeg", "hopper.mp4"});
}

TEST_CASE("A device is not replaced by a file") {
  TemporaryFolder folder;
  const std::string pipe =
      folder.File("pipe.mp4");  // stands for a device, which only root can make
  REQUIRE(mkfifo(pipe.c_str(), 0600) == 0);
  const std::string agent = WriteFallingAgent(folder);
  Words words = Evaluate(agent, pipe);
  words.emplace_back("--replace");
  const Words exported = {"dataset", "export", "HalfCheetah/none", pipe, "--replace"};
  for (const Words& command : {words, exported}) {
    const Outcome outcome = Run(command);
    CHECK(outcome.exit_code == 3);
    CHECK(outcome.err.find("a regular file to replace") != std::string::npos);
  }
  CHECK(std::filesystem::is_fifo(pipe));
}

TEST_CASE("A film that cannot be made is bad input and leaves no file") {
  TemporaryFolder folder;
  const std::string agent = WriteFallingAgent(folder);
  const std::string video = folder.File("missing/hopper.mp4");
  const Outcome nowhere = Run(Evaluate(agent, video));
  CHECK(nowhere.exit_code == 3);
  CHECK_FALSE(std::filesystem::exists(video));
  const Outcome without = Run(Evaluate(agent, folder.File("hopper.mp4")), {"PATH=/nowhere"});
  CHECK(without.exit_code == 3);
  CHECK(without.err.find("apt install ffmpeg") != std::string::npos);
  CHECK(FilesIn(folder.path()) == Words{"falls.h5"});
}

}  // namespace
}  // namespace b4mrl
