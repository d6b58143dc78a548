// A listening Unix socket, non-blocking; its file is removed with it.
#pragma once

#include <filesystem>

#include "protocols/result.h"
#include "tools/rig/file_handle.h"

namespace reforge {

class UnixListener {
 public:
  // `type`: SOCK_STREAM or SOCK_SEQPACKET. Replaces a socket an earlier run left behind.
  static Result<UnixListener> listen(const std::filesystem::path& file, int type);
  UnixListener(UnixListener&& other) noexcept;
  UnixListener& operator=(UnixListener&&) = delete;
  ~UnixListener();

  int fd() const { return socket_.get(); }
  FileHandle accept();  // none waiting: an empty handle; non-blocking

 private:
  UnixListener(FileHandle socket, std::filesystem::path file);
  FileHandle socket_;
  std::filesystem::path file_;
};

}  // namespace reforge
