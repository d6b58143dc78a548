// What libreforge-ptyport.so (ptyport_shim.c) tells of the ports: opened, closed, DTR. FORMATS.md,
// "Modem lines". A connection lasts as long as a program has the port open, so a killed program is
// a closed port.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "protocols/result.h"
#include "tools/rig/unix_listener.h"

namespace reforge {

struct ModemEvent {
  enum class Kind { kOpened, kClosed, kDtrHigh, kDtrLow };
  std::string device;  // "/dev/pts/N"
  Kind kind;
};

class ModemLines {
 public:
  static Result<ModemLines> listen(const std::filesystem::path& file);

  // Everything told so far, in order per port. Messages nobody understands are dropped.
  std::vector<ModemEvent> take();
  std::vector<int> fds() const;  // to wait for

 private:
  struct Program {
    FileHandle connection;
    std::string device;  // empty until it has said so
  };
  explicit ModemLines(UnixListener listener) : listener_(std::move(listener)) {}
  static bool drain(Program& program, std::vector<ModemEvent>& events);

  UnixListener listener_;
  std::vector<Program> programs_;
};

}  // namespace reforge
