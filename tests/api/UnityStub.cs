// The few types of Unity that palpate's components use, for a compiler without Unity.
using System;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
    }
    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
    }
    public class Transform
    {
        public Vector3 localPosition;
        public Quaternion localRotation = new Quaternion(0, 0, 0, 1);
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
