// What happens on a shop's floor: ports that come late or go, a journal that cannot be written,
// several operators, people without rights, policy that changes.
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/scenarios/shop.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

using api::JobState;
using api::Method;
using nlohmann::json;
using reforge::testing::of_kind;
using reforge::testing::Process;
using reforge::testing::read_file;
using reforge::testing::Shop;
using reforge::testing::write_file;

std::string milling(int strokes) {
  std::string out = "G21\nG90\nG94\nG17\nG54\nG0 Z100\nM3 S12000\nG4 P2\n";
  for (int i = 0; i < strokes; ++i) {
    out += "G1 X" + std::to_string(i % 2 * 5) + " Y" + std::to_string(i * 0.01) + " F1500\n";
  }
  return out + "M5\nM30\n";
}

bool says(const std::string& text, const char* what) {
  return text.find(what) != std::string::npos;
}

TEST(Floor, PortsThatAppearLaterAreFoundAndOnesThatGoEndTheJob) {
  Shop shop;
  shop.config["clock"] = "monotonic";
  shop.start_daemon();
  EXPECT_EQ(shop.rig_state(), "disconnected");
  shop.start_rig("1");
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; })) << shop.daemon_log();
  const auto job = shop.ready_job("long", milling(2000));
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(job).acknowledged > 20; }));
  shop.rig().send_signal(SIGKILL);  // both cables at once
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kInterrupted)) << shop.daemon_log();
  EXPECT_TRUE(says(shop.job(job).reason, "link was lost"));
  EXPECT_EQ(shop.rig_state(), "disconnected");
}

TEST(Floor, LockedJournalHoldsTheJobUntilItCanBeWritten) {
  Shop shop;
  shop.config["clock"] = "monotonic";
  shop.start_rig("1");
  shop.start_daemon();
  const auto job = shop.ready_job("long", milling(600));
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(job).acknowledged > 20; }));
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((shop.folder() / "state/journal.sqlite").c_str(), &other), SQLITE_OK);
  sqlite3_busy_timeout(other, 5000);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kHeld)) << shop.daemon_log();
  EXPECT_FALSE(shop.try_call(Method::kResume).ok());
  ASSERT_EQ(sqlite3_exec(other, "COMMIT", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(other);
  ASSERT_TRUE(shop.wait_until([&] { return shop.try_call(Method::kResume).ok(); }));
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kRunning));
  shop.call(Method::kAbort, {{"job", job}});
  EXPECT_TRUE(shop.wait_for_state(job, JobState::kAborted));
}

TEST(Floor, OfTwoOperatorsOneStartsAndBothMayHold) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const auto first = shop.ready_job("first", milling(2000));
  const auto second = shop.ready_job("second", milling(2000));
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  auto other = DaemonLink::connect((shop.folder() / "reforged.sock").string());
  ASSERT_TRUE(other.ok());
  ASSERT_TRUE(other->call(Method::kConfirm, {{"job", second}}).ok());
  shop.start(first);
  EXPECT_FALSE(other->call(Method::kStart, {{"job", second}}).ok());
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(first).acknowledged > 20; }));
  EXPECT_TRUE(other->call(Method::kHold, json::object()).ok());
  EXPECT_TRUE(shop.try_call(Method::kHold).ok());
  ASSERT_TRUE(shop.wait_for_state(first, JobState::kHeld));
  EXPECT_TRUE(other->call(Method::kResume, json::object()).ok());
  EXPECT_FALSE(shop.try_call(Method::kResume).ok());
  EXPECT_TRUE(other->call(Method::kAbort, {{"job", first}}).ok());
  EXPECT_TRUE(shop.wait_for_state(first, JobState::kAborted));
}

TEST(Floor, WhoHasNoRightIsToldSoAndAReloadTakesRightsAway) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can be somebody else";
  Shop shop;
  shop.config["roles"]["operate"]["users"] = {"nobody"};
  shop.start_rig();
  shop.start_daemon();
  chmod(shop.folder().c_str(), 0755);
  const std::string socket = (shop.folder() / "reforged.sock").string();
  chmod(socket.c_str(), 0666);
  const auto as_nobody = [&](const char* command) {
    std::filesystem::remove(shop.folder() / "nobody.log");
    Process client({"/usr/bin/setpriv", "--reuid=65534", "--clear-groups", REFORGE_CLI, command,
                    "--socket", socket},
                   {}, shop.folder() / "nobody.log");
    const auto end = client.end_within(60);
    return std::make_pair(end.value_or(-1), read_file(shop.folder() / "nobody.log"));
  };
  EXPECT_EQ(as_nobody("status").first, 0);
  EXPECT_TRUE(says(as_nobody("hold").second, "No job is running"));

  const auto reload = [&](const char* role) {
    shop.config["roles"]["operate"]["users"] = json::array();
    shop.config["roles"]["observe"]["users"] = json::array();
    if (role != nullptr) shop.config["roles"][role]["users"] = {"nobody"};
    write_file(shop.folder() / "reforged.json", shop.config.dump());
    shop.daemon().send_signal(SIGHUP);
  };
  reload("observe");
  ASSERT_TRUE(shop.wait_until([&] { return says(as_nobody("hold").second, "needs the role"); }));
  reload(nullptr);
  ASSERT_TRUE(shop.wait_until([&] { return says(as_nobody("status").second, "no role"); }));

  // A file with a mistake changes nothing.
  write_file(shop.folder() / "reforged.json", "{\"format\": \"reforged 1\", \"rolls\": 1}");
  shop.daemon().send_signal(SIGHUP);
  ASSERT_TRUE(shop.wait_until([&] { return says(shop.daemon_log(), "Not reloaded"); }));
  EXPECT_EQ(shop.rig_state().empty(), false);
}

TEST(Floor, UnknownKeyInTheConfigurationEndsTheDaemonAtOnce) {
  Shop shop;
  shop.config["colour"] = "red";
  write_file(shop.folder() / "reforged.json", shop.config.dump());
  Process daemon({REFORGE_DAEMON, "--config", (shop.folder() / "reforged.json").string()}, {},
                 shop.folder() / "reforged.log");
  EXPECT_EQ(daemon.end_within(30), 78);
  EXPECT_TRUE(says(shop.daemon_log(), "colour"));
}

TEST(Floor, SimulatedBackendRunsAJobWithoutAnyRig) {
  Shop shop;
  shop.config["clock"] = "monotonic";
  shop.config["backend"] = "simulated";
  shop.start_daemon();
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; })) << shop.daemon_log();
  const auto job = shop.ready_job(
      "short",
      "G21\nG90\nG94\nG17\nG54\nG0 Z60\nM70 S180\nG1 X1 F500\nM72 P0.3\nG1 X2 F500\nM73\n"
      "G0 Z60\nM71\nM30\n");
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return is_over(shop.job(job).state); }));
  EXPECT_EQ(shop.job(job).state, JobState::kDone) << shop.job(job).reason;
  EXPECT_EQ(shop.job(job).toggles, 4);
}

}  // namespace
}  // namespace reforge
