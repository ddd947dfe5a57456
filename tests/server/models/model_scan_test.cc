// References of MJCF files: those that leave the folder are named with their line.
#include "server/models/model_scan.h"

#include <unistd.h>

#include <filesystem>

#include "proto/base/limits.h"
#include "tests/server/models/model_fixture.h"

namespace b4mrl {
namespace {

// A models folder with a secret beside it.
struct Folder {
  Folder() : models(folder.File("models")) {
    std::filesystem::create_directories(models + "/parts");
    WriteBytes(folder.File("secret.xml"), "<mujoco/>");
    WriteBytes(models + "/parts/arm.xml", "<mujocoinclude/>");
  }
  Status Scan(const std::string& text) const {
    WriteBytes(models + "/model.xml", text);
    return ScanModelFile(models, "model.xml");
  }
  void Refuses(const std::string& text, const std::string& named) const {
    const Status status = Scan(text);
    INFO(text << "\n" << status.ToString());
    CHECK_FALSE(status.ok());
    CHECK_THAT(status.message(), Catch::Contains(named));
  }

  TemporaryFolder folder;
  std::string models;
};

TEST_CASE("References inside the folder pass") {
  const Folder folder;
  CHECK(folder.Scan("<mujoco/>").ok());
  CHECK(folder.Scan("<mujoco><include file='parts/arm.xml'/></mujoco>").ok());
  // A mesh that is not there is for the compiler to complain about.
  CHECK(
      folder.Scan("<mujoco><compiler meshdir='parts'/><asset><mesh file='a.stl'/></asset></mujoco>")
          .ok());
  CHECK(folder.Scan("<mujoco><asset><mesh file='..a/b..stl'/></asset></mujoco>").ok());
}

TEST_CASE("References that leave the folder are refused with their line") {
  const Folder folder;
  folder.Refuses("<mujoco>\n<include file='../secret.xml'/>\n</mujoco>", "model.xml, line 2");
  folder.Refuses("<mujoco>\n\n<asset><mesh file='/etc/passwd'/></asset></mujoco>", "line 3");
  folder.Refuses("<mujoco><asset><texture fileup='a/../../b.png'/></asset></mujoco>", "line 1");
  folder.Refuses("<mujoco><asset><hfield file='..\\b'/></asset></mujoco>", "line 1");
  folder.Refuses("<mujoco><asset><mesh file='C:\\b.stl'/></asset></mujoco>", "line 1");
  folder.Refuses("<mujoco><compiler meshdir='/etc'/></mujoco>", "line 1");
  folder.Refuses("<mujoco><compiler texturedir='..'/></mujoco>", "line 1");
  folder.Refuses("<mujoco><asset><skin file='&#46;&#46;/secret.xml'/></asset></mujoco>", "line 1");
}

TEST_CASE("Included files are read too, wherever they are included") {
  const Folder folder;
  WriteBytes(
      folder.models + "/parts/arm.xml",
      "<mujocoinclude>\n<worldbody><body>\n<include file='parts/hand.xml'/></body></worldbody>"
      "</mujocoinclude>");
  folder.Refuses("<mujoco><include file='parts/arm.xml'/></mujoco>", "parts/hand.xml");
  WriteBytes(folder.models + "/parts/hand.xml", "<a>\n<geom mesh='x' file='/x'/></a>");
  folder.Refuses("<mujoco><include file='parts/arm.xml'/></mujoco>", "parts/hand.xml, line 2");
}

TEST_CASE("Symbolic links that lead outside are refused, those within are not") {
  const Folder folder;
  const std::string link = folder.models + "/parts/link.xml";
  REQUIRE(symlink("arm.xml", link.c_str()) == 0);
  CHECK(folder.Scan("<mujoco><include file='parts/link.xml'/></mujoco>").ok());
  REQUIRE(unlink(link.c_str()) == 0);
  REQUIRE(symlink("../../secret.xml", link.c_str()) == 0);
  folder.Refuses("<mujoco>\n<include file='parts/link.xml'/></mujoco>", "line 2");
  // Also where only meshdir and file together name it.
  folder.Refuses(
      "<mujoco><asset><mesh file='link.xml'/></asset><compiler meshdir='parts'/></mujoco>",
      "link.xml");
  REQUIRE(symlink("../secret.xml", (folder.models + "/outside.xml").c_str()) == 0);
  CHECK_FALSE(ScanModelFile(folder.models, "outside.xml").ok());
}

TEST_CASE("What is no MJCF is refused with its line") {
  const Folder folder;
  folder.Refuses("<mujoco>\n<a>\n</mujoco>", "model.xml, line");
  folder.Refuses("", "model.xml");
  folder.Refuses("<robot name='x'/>", "robot");
  folder.Refuses("<mujoco/>" + std::string(limits::kMaxModelFileBytes, ' '), "longer than");
  std::string deep = "<mujoco>";
  for (int i = 0; i < 100'000; ++i) deep += "<a>";
  folder.Refuses(deep, "model.xml, line");
  std::string many = "<mujoco>";
  for (size_t i = 0; i <= limits::kMaxModelReferences; ++i) many += "<mesh file='a'/>";
  folder.Refuses(many + "</mujoco>", std::to_string(limits::kMaxModelReferences));
}

TEST_CASE("An inclusion loop ends") {
  const Folder folder;
  CHECK(folder.Scan("<mujoco><include file='model.xml'/></mujoco>").ok());  // MuJoCo refuses it
}

}  // namespace
}  // namespace b4mrl
