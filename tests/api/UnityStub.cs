// The few types of Unity that palpate's components use, for a compiler without Unity.
using System;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 operator +(Vector3 a, Vector3 b) { return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z); }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return new Vector3(a.x - b.x, a.y - b.y, a.z - b.z); }
    }
    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion Inverse(Quaternion q) { return new Quaternion(-q.x, -q.y, -q.z, q.w); }
        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y + a.y * b.w + a.z * b.x - a.x * b.z,
                                  a.w * b.z + a.z * b.w + a.x * b.y - a.y * b.x, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            Quaternion r = q * new Quaternion(v.x, v.y, v.z, 0) * Inverse(q);
            return new Vector3(r.x, r.y, r.z);
        }
    }
    public class Transform
    {
        public Transform parent;
        public Vector3 localPosition;
        public Quaternion localRotation = new Quaternion(0, 0, 0, 1);
        public Vector3 position { get { return parent == null ? localPosition : parent.position + parent.rotation * localPosition; } }
        public Quaternion rotation { get { return parent == null ? localRotation : parent.rotation * localRotation; } }
        public Vector3 InverseTransformPoint(Vector3 p) { return Quaternion.Inverse(rotation) * (p - position); }
    }
    public class MonoBehaviour
    {
        public Transform transform = new Transform();
        public Array children = new object[0];
        public T[] GetComponentsInChildren<T>()
        {
            System.Collections.Generic.List<T> found = new System.Collections.Generic.List<T>();
            foreach (object child in children)
                if (child is T) found.Add((T)child);
            return found.ToArray();
        }
    }
    public static class Time { public static double fixedTimeAsDouble; }
    public class AddComponentMenu : Attribute { public AddComponentMenu(string path) { } }
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
}
