// A folder of its own for a test, gone with it. Short: Unix sockets live in it.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace reforge {

struct ScratchFolder {
  ScratchFolder() {
    std::string name = std::filesystem::temp_directory_path() / "rig-XXXXXX";
    path = ::mkdtemp(name.data()) ? name : "";
  }
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path.empty()) std::filesystem::remove_all(path, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::filesystem::path path;
};

}  // namespace reforge
