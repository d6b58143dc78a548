#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <termios.h>

#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "tests/rig/scratch_folder.h"
#include "tools/rig/modem_lines.h"
#include "tools/rig/pty_port.h"

namespace reforge {
namespace {

using Kind = ModemEvent::Kind;

// A port with modem lines, and a foreign program on it.
struct Bench {
  Bench()
      : port(std::move(PtyPort::create(folder.path / "port").value())),
        modem(std::move(ModemLines::listen(folder.path / "dtr.sock").value())) {}
  ~Bench() {
    if (child > 0) {
      ::kill(child, SIGKILL);
      ::waitpid(child, nullptr, 0);
    }
  }

  void start(const std::string& mode) {
    std::vector<std::string> environment{
        "LD_PRELOAD=" REFORGE_PTYPORT_LIBRARY,
        "REFORGE_RIG_DTR=" + (folder.path / "dtr.sock").string(),
        "ASAN_OPTIONS=verify_asan_link_order=0:detect_leaks=0",
    };
    std::vector<std::string> arguments{REFORGE_PTYPORT_PROBE, port.link(), mode};
    const auto pointers = [](std::vector<std::string>& texts) {
      std::vector<char*> out;
      for (std::string& text : texts) out.push_back(text.data());
      out.push_back(nullptr);
      return out;
    };
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, (folder.path / "out").c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ASSERT_EQ(posix_spawn(&child, REFORGE_PTYPORT_PROBE, &actions, nullptr,
                          pointers(arguments).data(), pointers(environment).data()),
              0);
    posix_spawn_file_actions_destroy(&actions);
  }

  // What the program sends, up to a line's end.
  std::string read_line() {
    std::string bytes;
    while (bytes.find('\n') == std::string::npos) {
      pollfd ready{port.fd(), POLLIN, 0};
      if (::poll(&ready, 1, 20'000) != 1) return bytes;
      bytes += port.read();
    }
    return bytes;
  }

  int finish() {
    int status = 0;
    ::waitpid(std::exchange(child, 0), &status, 0);
    return status;
  }

  std::vector<Kind> kinds() {
    std::vector<Kind> out;
    for (const ModemEvent& event : modem.take()) {
      EXPECT_EQ(event.device, port.device());
      out.push_back(event.kind);
    }
    return out;
  }

  std::string printed() {
    std::ostringstream text;
    text << std::ifstream(folder.path / "out").rdbuf();
    return text.str();
  }

  ScratchFolder folder;
  PtyPort port;
  ModemLines modem;
  pid_t child = 0;
};

TEST(Ports, TheRealLibserialportOpensReadsAndWrites) {
  Bench bench;
  bench.start("echo");
  EXPECT_EQ(bench.read_line(), "hello\n");
  EXPECT_EQ(bench.kinds(), std::vector{Kind::kOpened});
  EXPECT_EQ(bench.port.write("answer\n"), 7u);
  EXPECT_EQ(bench.finish(), 0);
  EXPECT_EQ(bench.printed(), "answer\n");
  EXPECT_EQ(bench.kinds(), std::vector{Kind::kClosed});
}

TEST(Ports, DtrSetByTheProgramIsSeen) {
  Bench bench;
  bench.start("lower-dtr");
  EXPECT_EQ(bench.read_line(), "hello\n");
  EXPECT_EQ(bench.kinds(), (std::vector{Kind::kOpened, Kind::kDtrLow}));
  bench.port.write("\n");
  EXPECT_EQ(bench.finish(), 0);
}

TEST(Ports, AKilledProgramHasClosedItsPort) {
  Bench bench;
  bench.start("wait");
  EXPECT_EQ(bench.read_line(), "hello\n");
  EXPECT_EQ(bench.kinds(), std::vector{Kind::kOpened});
  ::kill(bench.child, SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(bench.finish()));
  EXPECT_EQ(bench.kinds(), std::vector{Kind::kClosed});
}

TEST(Ports, ClosingDropsDtrUnlessTheProgramSaysOtherwise) {
  Bench bench;
  EXPECT_TRUE(bench.port.drops_dtr_on_close());
  const FileHandle program(::open(bench.port.link().c_str(), O_RDWR | O_NOCTTY));
  termios settings{};
  ASSERT_EQ(tcgetattr(program.get(), &settings), 0);
  settings.c_cflag &= ~static_cast<tcflag_t>(HUPCL);
  ASSERT_EQ(tcsetattr(program.get(), TCSANOW, &settings), 0);
  EXPECT_FALSE(bench.port.drops_dtr_on_close());
}

TEST(Ports, TheLinkIsRemovedWithThePortAndReplacedWhenStale) {
  ScratchFolder folder;
  const auto link = folder.path / "cnc";
  std::filesystem::create_symlink("/dev/null", link);
  {
    const auto port = PtyPort::create(link);
    ASSERT_TRUE(port.ok()) << port.error().sentence;
    EXPECT_EQ(std::filesystem::read_symlink(link), (*port).device());
  }
  EXPECT_FALSE(std::filesystem::is_symlink(link));
}

TEST(Ports, AFileInThePlaceOfTheLinkIsLeftAlone) {
  ScratchFolder folder;
  std::ofstream(folder.path / "cnc") << "mine";
  EXPECT_FALSE(PtyPort::create(folder.path / "cnc").ok());
  EXPECT_TRUE(std::filesystem::is_regular_file(folder.path / "cnc"));
}

TEST(Ports, APulledCableIsAHangUpAndComesBackUnderItsOrAnothersName) {
  ScratchFolder folder;
  auto cnc = PtyPort::create(folder.path / "cnc");
  auto extruder = PtyPort::create(folder.path / "extruder");
  ASSERT_TRUE(cnc && extruder);
  const int fd = ::open((folder.path / "cnc").c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
  ASSERT_GE(fd, 0);
  cnc->unplug();
  extruder->unplug();
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(folder.path / "cnc")));
  EXPECT_EQ(::write(fd, "x", 1), -1);
  EXPECT_EQ(errno, EIO);
  ::close(fd);
  EXPECT_EQ(cnc->read(), "");
  EXPECT_EQ(cnc->write("lost"), 0u);
  PtyPort::swap_names(*cnc, *extruder);
  ASSERT_TRUE(cnc->plug());
  ASSERT_TRUE(extruder->plug());
  EXPECT_EQ(std::filesystem::read_symlink(folder.path / "extruder"), cnc->device());
  EXPECT_EQ(std::filesystem::read_symlink(folder.path / "cnc"), extruder->device());
}

}  // namespace
}  // namespace reforge
