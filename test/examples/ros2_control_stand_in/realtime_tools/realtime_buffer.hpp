#pragma once
namespace realtime_tools
{
template <class T>
class RealtimeBuffer
{
public:
  void writeFromNonRT(const T & data);
  T * readFromRT();
};
}  // namespace realtime_tools
