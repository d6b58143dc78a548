#include "tools/rig/unix_listener.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <cerrno>
#include <cstring>

namespace reforge {

UnixListener::UnixListener(FileHandle socket, std::filesystem::path file)
    : socket_(std::move(socket)), file_(std::move(file)) {}

UnixListener::UnixListener(UnixListener&& other) noexcept
    : socket_(std::move(other.socket_)), file_(std::exchange(other.file_, {})) {}

UnixListener::~UnixListener() {
  std::error_code ignored;
  if (!file_.empty()) std::filesystem::remove(file_, ignored);
}

Result<UnixListener> UnixListener::listen(const std::filesystem::path& file, int type) {
  const auto failed = [&](const std::string& why) {
    return Error{Code::kDevice, "Nothing can listen on " + file.string() + ": " + why};
  };
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (file.native().size() >= sizeof address.sun_path) {
    return failed("the path is longer than " + std::to_string(sizeof address.sun_path - 1) +
                  " bytes");
  }
  std::memcpy(address.sun_path, file.c_str(), file.native().size() + 1);
  std::error_code ignored;
  if (std::filesystem::is_socket(file, ignored)) std::filesystem::remove(file, ignored);
  FileHandle socket(::socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!socket ||
      ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(socket.get(), 16) != 0) {
    return failed(std::strerror(errno));
  }
  return UnixListener(std::move(socket), file);
}

FileHandle UnixListener::accept() {
  return FileHandle(::accept4(socket_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
}

}  // namespace reforge
