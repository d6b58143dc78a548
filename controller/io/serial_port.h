// One serial link: libserialport opens and configures it, the io_context drives its handle.
//
// 8N1, no flow control. The port is held exclusively (flock and TIOCEXCL): nobody else's bytes can
// slip into a job. HUPCL is cleared, so that closing the port, or dying, does not reset a UNO; the
// first opening after power-up still does, and its banner has to be awaited. What was waiting in
// the port when it is opened is thrown away. A hang-up (unplugged, or the virtual rig has gone) is
// told once by on_lost; the port is closed then. Lives in the io_context's thread. Handlers are
// never called from inside open, write or close.
//
// Limit: bytes are handed to the kernel as they come and not paced at the line's rate; what bounds
// the bytes before an urgent one is the CNC's receive buffer, which the core never overfills.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "protocols/result.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

class SerialPort {
 public:
  struct Handlers {
    std::function<void(std::string_view bytes)> on_bytes;
    std::function<void(std::string sentence)> on_lost;
    std::function<void()> on_written;  // bytes that had to wait for the kernel are gone
  };

  SerialPort(boost::asio::io_context& io, Handlers handlers);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  Status open(const std::string& path, int baud);
  void close();
  bool is_open() const;

  // Bytes leave in order; urgent ones before all that still wait here. Ignored while closed.
  void write(std::string_view bytes, bool urgent);
  void drop_unsent();

  // Of all openings. counted_from() replaces what has been read: the virtual rig's count.
  std::uint64_t bytes_read() const;
  std::uint64_t bytes_written() const;
  void counted_from(std::uint64_t bytes_read);

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace reforge
