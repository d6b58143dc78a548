// The real program given what a shop may hand it: every file of the shared models' `bad` folder
// ends as expected there, within ten seconds of processor time and 1 GiB.
#if defined(REFORGE_SHARED_MODELS) && defined(REFORGE_CLI)

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace reforge {
namespace {

namespace fs = std::filesystem;

constexpr int kBadInput = 3;
#if defined(__SANITIZE_ADDRESS__)  // its checks and its shadow come on top
constexpr rlim_t kSeconds = 100;
constexpr long kMostKib = 4L << 20;
#else
constexpr rlim_t kSeconds = 10;
constexpr long kMostKib = 1L << 20;
#endif

struct Ended {
  int exit_code = -1;  // minus the signal, if one ended it
  long peak_kib = 0;
  std::string said;  // on stderr
};

// Plans the part as its own repair: a file that is accepted needs no search.
Ended plan(const fs::path& part, const fs::path& folder) {
  const fs::path said = folder / "stderr", job = folder / "job";
  const pid_t child = fork();
  if (child == 0) {
    const rlimit seconds{kSeconds, kSeconds};
    setrlimit(RLIMIT_CPU, &seconds);
    const int log = open(said.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    const int nothing = open("/dev/null", O_WRONLY);
    dup2(log, STDERR_FILENO);
    dup2(nothing, STDOUT_FILENO);
    const std::string rig = REFORGE_SOURCE_DIR "/config/rigs/mx220.json";
    execl(REFORGE_CLI, REFORGE_CLI, "plan", part.c_str(), part.c_str(), "--mode", "paper",
          "--effort", "fast", "--rig", rig.c_str(), "-o", job.c_str(), "--force",
          static_cast<char*>(nullptr));
    _exit(127);
  }
  int status = 0;
  rusage used{};
  wait4(child, &status, 0, &used);
  std::stringstream text;
  text << std::ifstream(said).rdbuf();
  return {WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status), used.ru_maxrss,
          text.str()};
}

const fs::path kBad = fs::path(REFORGE_SHARED_MODELS) / "bad";

struct Expected {
  std::string file, what;
};
std::vector<Expected> expected_ends() {
  std::ifstream stream(kBad / "EXPECTED.json");
  const auto entries = nlohmann::json::parse(stream, nullptr, false);
  std::vector<Expected> all;
  if (!entries.is_object()) return all;
  for (const auto& [name, entry] : entries.items()) all.push_back({name, entry["expect"]});
  return all;
}

class BadFiles : public ::testing::TestWithParam<Expected> {
 protected:
  BadFiles() {
    std::string name = (fs::temp_directory_path() / "bad-files-XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~BadFiles() override {
    std::error_code ignored;  // a folder left behind harms nobody
    fs::remove_all(folder_, ignored);
  }
  fs::path folder_;
};

TEST_P(BadFiles, EndsAsExpectedAndIsNamed) {
  const auto& [name, expect] = GetParam();
  SCOPED_TRACE(name + ": " + expect);
  const Ended ended = plan(kBad / name, folder_);
  EXPECT_GE(ended.exit_code, 0) << "ended by signal " << -ended.exit_code;
  EXPECT_LE(ended.peak_kib, kMostKib);
  if (expect == "reject") {
    EXPECT_EQ(ended.exit_code, kBadInput) << ended.said;
  } else if (expect.starts_with("accept") && expect.find("reject") == std::string::npos) {
    EXPECT_TRUE(ended.exit_code == 0 || ended.exit_code == 1) << ended.said;
  } else {
    EXPECT_TRUE(ended.exit_code == 0 || ended.exit_code == 1 || ended.exit_code == kBadInput);
  }
  if (ended.exit_code != kBadInput) return;
  EXPECT_NE(ended.said.find(name), std::string::npos) << ended.said;
  EXPECT_GT(ended.said.size(), name.size() + 30) << ended.said;  // the fault is told
}

TEST(BadFileList, IsWhole) {
  EXPECT_GT(expected_ends().size(), 40u);
}

INSTANTIATE_TEST_SUITE_P(Shared, BadFiles, ::testing::ValuesIn(expected_ends()),
                         [](const auto& file) {
                           std::string name = file.param.file;
                           for (char& c : name)
                             c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
                           return name;
                         });

}  // namespace
}  // namespace reforge

#endif
