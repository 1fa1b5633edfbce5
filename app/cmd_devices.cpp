// binrig devices: what can be opened, and why something cannot.
#include <dirent.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "app/commands.h"
#include "app/open.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Vendors whose USB devices are depth cameras or sit inside them.
const std::map<std::string, std::string>& depth_camera_vendors() {
  static const std::map<std::string, std::string> table{
      {"8086", "Intel (RealSense)"}, {"1d27", "PrimeSense / Asus Xtion"}, {"2bc5", "Orbbec"},
      {"045e", "Microsoft (Kinect)"}, {"03e7", "Luxonis"},                {"2b03", "Stereolabs"},
  };
  return table;
}

std::string first_line(const fs::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

// Reads the kernel's list of USB devices; opens none of them.
json usb_devices(const std::string& sysfs) {
  json list = json::array();
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(sysfs, ignored)) {
    const std::string vendor = first_line(entry.path() / "idVendor");
    const auto known = depth_camera_vendors().find(vendor);
    if (known == depth_camera_vendors().end()) continue;
    const int bus = std::atoi(first_line(entry.path() / "busnum").c_str());
    const int device = std::atoi(first_line(entry.path() / "devnum").c_str());
    const std::string node = fmt::format("/dev/bus/usb/{:03d}/{:03d}", bus, device);
    json item = {{"kind", "usb"},
                 {"id", vendor + ":" + first_line(entry.path() / "idProduct")},
                 {"vendor", known->second},
                 {"product", first_line(entry.path() / "product")},
                 {"serial", first_line(entry.path() / "serial")},
                 {"node", node}};
    if (::access(node.c_str(), F_OK) != 0) item["problem"] = node + " does not exist: the device is gone or hidden from this container";
    else if (::access(node.c_str(), R_OK | W_OK) != 0) item["problem"] = "no permission to open " + node + ": a udev rule or the group plugdev is missing";
    else item["problem"] = "seen, but this program has no driver for it: record it with its own tools into a recording set";
    list.push_back(item);
  }
  return list;
}

}  // namespace

void add_devices(CLI::App& app, int& /*status*/) {
  CLI::App* verb = app.add_subcommand("devices", "what is plugged in or can be opened, and why a device cannot be opened");
  auto as_json = std::make_shared<bool>(false);
  auto sysfs = std::make_shared<std::string>("/sys/bus/usb/devices");
  verb->add_flag("--json", *as_json, "as JSON");
  verb->add_option("--sysfs", *sysfs, "where the kernel lists USB devices");
  verb->callback([=] {
    const json usb = usb_devices(*sysfs);
    json schemes = json::array();
    for (const Scheme& scheme : source_schemes()) schemes.push_back({{"uri", scheme.pattern}, {"meaning", scheme.meaning}});
    if (*as_json) {
      fmt::print("{}\n", json{{"devices", usb}, {"sources", schemes}, {"recordings", recordings_folder()}}.dump(1));
      return;
    }
    if (usb.empty()) fmt::print("No USB depth camera is plugged in ({} was read; nothing was opened or sent).\n", *sysfs);
    for (const json& item : usb) {
      fmt::print("{}  {} {}  serial {}\n    {}\n", item["id"].get<std::string>(), item["vendor"].get<std::string>(),
                 item["product"].get<std::string>(), item["serial"].get<std::string>(), item["problem"].get<std::string>());
    }
    fmt::print("\nSources that can be opened without a device:\n");
    for (const Scheme& scheme : source_schemes()) fmt::print("  {:<55} {}\n", scheme.pattern, scheme.meaning);
    if (!recordings_folder().empty()) fmt::print("\nRecordings: {}\n", recordings_folder());
  });
}

}  // namespace binrig
