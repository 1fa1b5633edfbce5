// The one exception of binrig, and the list of violations it carries.
//
// Configuration and misuse throw; whatever a sensor does (a timeout, lost packets, an unplugged cable) is data on the
// frame and never an exception (see core/frame.h).
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace binrig {

/// One thing that is wrong, in the words of the person who can mend it. Every field but `message` may be empty.
struct Violation {
  std::string where;    ///< "models/kinect.yaml:12", "SET/train/000001/depth/000003.png", "--frames"
  std::string key;      ///< the key or parameter, e.g. "spectral_noise.sigma"
  std::string value;    ///< the value found, as it was written
  std::string unit;     ///< unit of value and bounds, e.g. "mm"
  std::string bounds;   ///< what would be accepted, e.g. "0.001 .. 10"
  std::string message;  ///< one clause without a full stop, e.g. "is out of bounds"

  /// One line: "where: key = value unit message (accepted: bounds unit)", leaving out what is empty.
  std::string text() const;
};

/// Which exit status an uncaught Error becomes (DESIGN: 2 = bad usage or input, 3 = device trouble).
enum class ErrorKind { input, device };

class Error : public std::runtime_error {
 public:
  /// `what()` is the summary followed by one indented line per violation.
  Error(const std::string& summary, std::vector<Violation> violations, ErrorKind kind = ErrorKind::input);
  /// An error without details, where the summary says it all.
  explicit Error(const std::string& summary, ErrorKind kind = ErrorKind::input);

  const std::vector<Violation>& violations() const { return violations_; }
  ErrorKind kind() const { return kind_; }

 private:
  std::vector<Violation> violations_;
  ErrorKind kind_;
};

/// Collects violations so that a user sees all of them at once.
class Violations {
 public:
  void add(Violation violation) { list_.push_back(std::move(violation)); }
  void add(std::string where, std::string key, std::string message);
  void add_all(const std::vector<Violation>& more);
  bool empty() const { return list_.empty(); }
  const std::vector<Violation>& list() const { return list_; }

  /// Throws Error(summary, everything collected) unless the list is empty.
  void throw_if_any(const std::string& summary) const;

 private:
  std::vector<Violation> list_;
};

/// Shortest text that reads back as the same double ("0.1", "1134.15", "nan"); for messages and files.
std::string number_text(double value);

/// The candidate nearest to `word` by edit distance (at most a third of its length away), or "" if none is near.
std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace binrig
